// Plays an animation: a button, a slider, a choice of speed, a readout, and the instant in the plot beside it.
"use strict";
function unpack(one) {
  return one && new Float32Array(Uint8Array.from(atob(one.bdata), c => c.charCodeAt(0)).buffer);
}
// The path of an orbit between two frames.
function path(ys, zs, scale, from, to) {
  let d = "";
  for (let i = from; i <= to; i++) d += `${d ? "L" : "M"}${(ys[i] * scale).toFixed(1)} ${(-zs[i] * scale).toFixed(1)}`;
  return d;
}
// Calls `draw` with the frame, the frame one revolution before, a function that interpolates a signal, and the time in s.
function play(root, {timeFactor, ...data}, draw) {
  const t = unpack(data.t), theta = unpack(data.theta), valid = unpack(data.valid);
  const last = t.length - 1, step = t[last] / last;
  root.querySelector(".readout").insertAdjacentHTML("beforebegin", `<div class="controls"><button type="button" id="play"></button>
    <input type="range" id="seek" min="0" max="${last}" step="any" aria-label="Instant">
    <label>speed <select id="speed">${[500, 200, 100, 50, 20, 10, 5, 1].map(n => `<option value="${n}">${n > 1 ? "1/" + n : "1"}</option>`).join("")}</select></label></div>`);
  const [button, seek, speed] = ["play", "seek", "speed"].map(id => document.getElementById(id));

  // One revolution per second, or the whole run in ten seconds if the rotor does not turn.
  const turns = Math.abs(theta[last] - theta[0]) / (2 * Math.PI);
  const wanted = turns > 1 ? turns / t[last] : 10 / t[last];
  const speeds = [...speed.options].map(option => Number(option.value));
  speed.value = speeds.reduce((a, b) => Math.abs(Math.log(b / wanted)) < Math.abs(Math.log(a / wanted)) ? b : a);
  // In the plot beside the animation, later times are dimmed.
  const plot = document.querySelector("#lambda .plot");
  const veil = Object.assign(document.createElement("div"), {className: "veil"});
  if (plot) {
    plot.addEventListener("drawn", () => {
      if (veil.parentNode) return;
      // Above the lines, below legend and values.
      plot.querySelectorAll(".main-svg")[1].before(veil);
      plot.on("plotly_afterplot", paint);
      plot.on("plotly_click", click => { at = click.points[0].x / timeFactor / step; pause(); paint(); });
      paint();
    });
  }
  function cover() {
    const layout = plot && plot._fullLayout;
    if (!layout || !veil.parentNode) return;
    const {xaxis, yaxis} = layout, from = Math.min(Math.max(xaxis.l2p(at * step * timeFactor), 0), xaxis._length);
    veil.style.cssText = `left:${xaxis._offset + from}px;width:${xaxis._length - from}px;top:${yaxis._offset}px;height:${yaxis._length}px`;
  }

  let at = 0, playing = false, stamped = null;
  function paint() {
    const i = Math.min(Math.floor(at), last), next = Math.min(i + 1, last), part = at - i;
    let before = i;
    while (before > 0 && i - before < 600 && Math.abs(theta[i] - theta[before]) < 2 * Math.PI) before--;
    const now = at * t[last] / last;
    draw(i, before, values => values[i] + part * (values[next] - values[i]), now);
    document.getElementById("now").textContent = `t ${(now * timeFactor).toFixed(timeFactor > 1 ? 1 : 3)} ${timeFactor > 1 ? "ms" : "s"}` +
      (valid ? valid[i] > 0.5 ? ", valid" : ", not valid" : "");
    seek.value = at;
    cover();
  }
  function frame(stamp) {
    if (!playing) return;
    if (stamped !== null) at += Math.min(stamp - stamped, 100) / 1000 / Number(speed.value) / step;
    stamped = stamp;
    if (at >= last) { at = last; pause(); }
    paint();
    if (playing) requestAnimationFrame(frame);
  }
  function pause() { playing = false; stamped = null; button.textContent = "▶"; button.setAttribute("aria-label", "Play"); }
  function start() {
    if (at >= last) at = 0;
    playing = true;
    button.textContent = "❚❚";
    button.setAttribute("aria-label", "Pause");
    requestAnimationFrame(frame);
  }
  button.addEventListener("click", () => playing ? pause() : start());
  seek.addEventListener("input", () => { at = Number(seek.value); pause(); paint(); });
  // A printed page shows the end of the run.
  let onScreen = null;
  addEventListener("beforeprint", () => { onScreen ??= at; at = last; pause(); paint(); });
  addEventListener("afterprint", () => { at = onScreen ?? at; onScreen = null; paint(); });
  // A page may be opened at an instant in s, paused: report.html#t=0.12
  const requested = /^#t=([0-9.]+)$/.exec(location.hash);
  pause();
  if (requested) at = Math.min(Number(requested[1]) / step, last);
  else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) start();
  paint();
}
