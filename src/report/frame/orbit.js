// The animation: the rotor in its clearance between the magnets, and their forces.
"use strict";
(() => {
  const root = document.getElementById("orbit-animation");
  if (!root) return;
  const data = JSON.parse(root.firstElementChild.textContent);
  const t = unpack(data.t), y = unpack(data.y), z = unpack(data.z), theta = unpack(data.theta);
  const refY = unpack(data.refY), refZ = unpack(data.refZ), contact = unpack(data.contact);
  const force = data.force.map(unpack), lambda = data.lambda && data.lambda.map(unpack);
  const last = t.length - 1;
  if (last < 1) return;

  // Lengths in the drawing; displacements and gaps have one scale, the real rotor is far larger.
  const ROTOR = 92, RING = 158, ARROW = 74, VIEW = 330;
  const scale = (RING - ROTOR) / data.clearance, pole = ROTOR + data.gap * scale;
  // An impact of a few samples must not shorten all other arrows.
  const sorted = Float32Array.from(force.flatMap(values => [...values])).sort();
  const most = Math.max(1e-9, sorted[Math.floor(0.98 * sorted.length)]);
  const degrees = 180 / Math.PI;
  const text = number => number.toFixed(number < 9.995 ? 1 : 0);
  const magnet = k => `<g transform="rotate(${data.alpha[k] * degrees})">
    <path class="iron" d="M-66 ${-pole}V${-pole - 78}Q-66 ${-pole - 92} -52 ${-pole - 92}H52Q66 ${-pole - 92} 66 ${-pole - 78}V${-pole}H30V${-pole - 56}H-30V${-pole}Z"/>
    <g class="coil" id="coil${k}" style="fill:var(--magnet${k + 1})"><rect x="-74" y="${-pole - 50}" width="52" height="36" rx="5"/><rect x="22" y="${-pole - 50}" width="52" height="36" rx="5"/></g></g>`;
  const label = k => {
    const r = pole + 30, a = data.alpha[k];
    return `<text class="pull" id="pull${k}" x="${r * Math.sin(a)}" y="${-r * Math.cos(a) + 6}" style="fill:var(--magnet${k + 1})"></text>`;
  };
  const arrow = k => `<g id="arrow${k}" style="stroke:var(--magnet${k + 1});fill:var(--magnet${k + 1})"><path class="shaft"/><path class="tip" d="M0 0L-7 13H7Z"/></g>`;
  const bar = data.clearance > 150 ? 100 : data.clearance > 15 ? 10 : 1;
  root.innerHTML = `<svg viewBox="${-VIEW} ${-VIEW + 40} ${2 * VIEW} ${2 * VIEW - 44}" role="img" aria-label="The rotor in its clearance between its magnets">
    <defs><radialGradient id="steel" cx=".38" cy=".34" r=".8"><stop offset="0"/><stop offset="1"/></radialGradient></defs>
    ${data.alpha.map((_, k) => magnet(k)).join("")}
    <circle class="ring" r="${RING}"/>
    <circle class="body" r="${ROTOR}"/><g id="rotor"><path class="mark" d="M0 0H${ROTOR}"/><circle class="dot" cx="${ROTOR - 11}" r="5"/></g>
    <path class="reference"/><path class="trail"/><circle class="centre" r="3.2"/>
    ${data.alpha.map((_, k) => arrow(k)).join("")}${data.alpha.map((_, k) => label(k)).join("")}
    <g class="axes"><path d="M${-VIEW + 22} ${VIEW - 32}h44m-6 -4l6 4l-6 4M${-VIEW + 22} ${VIEW - 32}v-44m-4 6l4 -6l4 6"/><text x="${-VIEW + 74}" y="${VIEW - 27}">y</text><text x="${-VIEW + 17}" y="${VIEW - 84}">z</text>
    <path d="M${VIEW - 30 - bar * scale} ${VIEW - 32}h${bar * scale}m0 -5v10m${-bar * scale} -10v10"/><text x="${VIEW - 30 - bar * scale / 2}" y="${VIEW - 42}" text-anchor="middle">${bar} µm</text></g>
    <text class="event" y="${-VIEW + 62}" x="${-VIEW + 14}"></text></svg>
    <p class="readout"><span id="now"></span>${lambda ? data.alpha.map((_, k) => `<span style="color:var(--magnet${k + 1})" id="hat${k}"></span>`).join("") : ""}</p>`;
  const get = id => document.getElementById(id);
  const find = selector => root.querySelector(selector);
  const rotor = get("rotor");
  const centre = find(".centre"), body = find(".body"), trail = find(".trail"), ring = find(".ring"), event = find(".event");

  play(root, data, (i, before, value, now) => {
    const cy = value(y) * scale, cz = -value(z) * scale;
    rotor.setAttribute("transform", `translate(${cy} ${cz}) rotate(${-value(theta) * degrees})`);
    for (const circle of [centre, body]) {
      circle.setAttribute("cx", cy);
      circle.setAttribute("cy", cz);
    }
    trail.setAttribute("d", path(y, z, scale, before, i));
    if (refY && refZ) find(".reference").setAttribute("d", path(refY, refZ, scale, before, i));
    ring.classList.toggle("hit", Boolean(contact && contact[i] > 0.5));
    for (let k = 0; k < data.alpha.length; k++) {
      const pull = Math.max(0, value(force[k])), long = Math.min(pull / most, 1.3) * ARROW;
      const shaft = get(`arrow${k}`);
      shaft.setAttribute("transform", `translate(${cy} ${cz}) rotate(${data.alpha[k] * degrees}) translate(0 ${-ROTOR})`);
      shaft.firstChild.setAttribute("d", `M0 0V${-Math.max(0, long - 12)}`);
      shaft.lastChild.setAttribute("transform", `translate(0 ${-long}) scale(${Math.min(1, long / 13)})`);
      get(`coil${k}`).style.fillOpacity = 0.18 + 0.82 * Math.min(1, Math.sqrt(pull / most));
      get(`pull${k}`).textContent = `${text(pull)} N`;
      if (lambda) get(`hat${k}`).textContent = `λ̂${"₁₂₃₄"[k]} ${lambda[k][i].toFixed(3)}`;
    }
    // Events stay visible for a while.
    const recent = data.events.filter(([when]) => when <= now && now < when + (40 / last + 0.06) * t[last]).pop();
    event.textContent = recent ? recent[1] : "";
  });
})();
