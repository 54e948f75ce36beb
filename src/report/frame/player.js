// Plays an animation of the frames at the instants t: a button, a slider, a choice of speed, and the instant in the plot beside it.
"use strict";
function play(root, t, theta, timeFactor, draw) {
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
  // In the plot beside it, the time still to come is dimmed.
  const plot = document.querySelector("#lambda .plot");
  const veil = Object.assign(document.createElement("div"), {className: "veil"});
  if (plot) {
    plot.addEventListener("drawn", () => {
      if (veil.parentNode) return;
      // Between the lines and the layer with legend and values.
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

  let at = 0, playing = false, before = null;
  function paint() {
    draw(at);
    seek.value = at;
    cover();
  }
  function frame(stamp) {
    if (!playing) return;
    if (before !== null) at += Math.min(stamp - before, 100) / 1000 / Number(speed.value) / step;
    before = stamp;
    if (at >= last) { at = last; pause(); }
    paint();
    if (playing) requestAnimationFrame(frame);
  }
  function pause() { playing = false; before = null; button.textContent = "▶"; button.setAttribute("aria-label", "Play"); }
  function start() {
    if (at >= last) at = 0;
    playing = true;
    button.textContent = "❚❚";
    button.setAttribute("aria-label", "Pause");
    requestAnimationFrame(frame);
  }
  button.addEventListener("click", () => playing ? pause() : start());
  seek.addEventListener("input", () => { at = Number(seek.value); pause(); paint(); });
  // Paper shows the end of the run.
  let seen = null;
  addEventListener("beforeprint", () => { seen ??= at; at = last; pause(); paint(); });
  addEventListener("afterprint", () => { at = seen ?? at; seen = null; paint(); });
  // A page may be opened at an instant in s, stopped: report.html#t=0.12
  const asked = /^#t=([0-9.]+)$/.exec(location.hash);
  pause();
  if (asked) at = Math.min(Number(asked[1]) / step, last);
  else if (!matchMedia("(prefers-reduced-motion: reduce)").matches) start();
  paint();
}
