// The animation of a spindle: the shaft from the side and from above, and its orbits in the bearings A and B.
"use strict";
(() => {
  const root = document.getElementById("shaft-animation");
  if (!root) return;
  const data = JSON.parse(root.firstElementChild.textContent);
  const x = unpack(data.x);
  const orbits = data.orbits.map(pair => pair.map(unpack));
  if (x.length < 2) return;

  // Along the shaft 1 m is LENGTH / extent; displacements across and along it have one larger scale.
  const LENGTH = 500, GAP = 40, THICK = 17, ORBIT = 92;
  const [begin, end] = data.extent, along = LENGTH / (end - begin);
  const at = position => (position - 0.5 * (begin + end)) * along - 20;
  const scale = GAP / data.clearance, orbitScale = ORBIT / data.clearance;
  // The axial disc is drawn beyond the end of the shaft, clear of the bearings.
  const disc = at(end) + 34;
  const pair = (place, y, which) => [-1, 1].map(side =>
    `<g class="${which}"><rect class="iron" x="${place - 20}" y="${y + side * (THICK + GAP + 16) - 16}" width="40" height="32" rx="4"/></g>`).join("");
  const view = (y, name, vertical) => `<g>
    ${data.bearings.map(position => pair(at(position), y, "pole")).join("")}
    ${data.sensors.map(position => `<path class="sensor" d="M${at(position)} ${y - THICK - GAP}v-30m0 0l-5 -9h10z"/>`).join("")}
    <path class="iron" d="M${disc - 34} ${y - 62}h12v38h-12zM${disc + 22} ${y - 62}h12v38h-12zM${disc - 34} ${y + 24}h12v38h-12zM${disc + 22} ${y + 24}h12v38h-12z"/>
    <g class="bar"><rect class="body" x="${at(begin)}" y="${y - THICK}" width="${disc + 24 - at(begin)}" height="${2 * THICK}" rx="5"/>
    <rect class="body" x="${disc - 7}" y="${y - 58}" width="14" height="116" rx="3"/>
    <path class="mark" d="M${at(begin)} ${y}H${disc + 24}"/></g>
    <text class="name" x="${at(begin) - 72}" y="${y - 34}">${name}</text><text class="name" x="${at(begin) - 72}" y="${y - 12}">${vertical} ↑</text></g>`;
  const orbit = (place, name) => `<g transform="translate(${place} 400)"><circle class="ring" r="${ORBIT}"/><path class="trail"/><circle class="centre" r="4.5"/>
    <text class="name" x="${-ORBIT - 26}" y="${-ORBIT + 14}">${name}</text></g>`;
  root.innerHTML = `<svg viewBox="-352 -148 704 652" role="img" aria-label="The shaft in its bearings, from the side and from above, and its orbits">
    <defs><linearGradient id="steel" x1="0" x2="0" y1="0" y2="1"><stop offset="0"/><stop offset="1"/></linearGradient></defs>
    ${view(-20, "side", "z")}${view(190, "above", "y")}
    ${data.bearings.map((position, n) => `<text class="name" text-anchor="middle" x="${at(position)}" y="-122">${"AB"[n]}</text>`).join("")}
    <text class="name" text-anchor="middle" x="${disc}" y="-122">X</text>
    ${orbit(-150, "A")}${orbit(150, "B")}</svg>
    <p class="readout"><span id="now"></span></p>`;
  const bars = [...root.querySelectorAll(".bar")], trails = [...root.querySelectorAll(".trail")], centres = [...root.querySelectorAll(".centre")];
  const [a, b] = data.bearings;

  play(root, data, (i, before, value) => {
    // Side view: z upwards; view from above: y upwards.
    [1, 0].forEach((axis, n) => {
      const [inA, inB] = orbits.map(pair => value(pair[axis]) * scale);
      const tilt = (inB - inA) / (at(b) - at(a)), middle = inA - tilt * at(a), y = n ? 190 : -20;
      bars[n].setAttribute("transform", `translate(${value(x) * scale} ${-middle}) rotate(${-Math.atan(tilt) * 180 / Math.PI} 0 ${y})`);
    });
    orbits.forEach(([ys, zs], n) => {
      trails[n].setAttribute("d", path(ys, zs, orbitScale, before, i));
      centres[n].setAttribute("cx", value(ys) * orbitScale);
      centres[n].setAttribute("cy", -value(zs) * orbitScale);
    });
  });
})();
