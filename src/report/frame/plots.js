// Draws the plots of the page with plotly.js, which the page contains compressed, and links those over time.
"use strict";
(async () => {
  const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), c => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const script = document.createElement("script");
  script.textContent = await new Response(stream).text();
  document.head.append(script);

  const plots = [...document.querySelectorAll(".plot")];
  const specs = new Map(plots.map(div => [div, JSON.parse(div.firstElementChild.textContent)]));
  const linked = plots.filter(div => "overTime" in div.dataset);
  // Touch scrolls the page; the buttons of a plot zoom.
  const touch = matchMedia("(pointer: coarse)").matches;
  let shown = null;

  // Replaces colour names by the colours of the style, light or dark.
  const style = () => getComputedStyle(document.documentElement);
  function resolved(value) {
    if (typeof value === "string" && value.startsWith("--")) return style().getPropertyValue(value).trim();
    if (Array.isArray(value)) return value.map(resolved);
    if (value && typeof value === "object") return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, resolved(v)]));
    return value;
  }
  // Each axis adjusts only the margin on its own side: otherwise the last number of x would move the margin back and forth.
  const axis = (own, automargin) => ({gridcolor: "--grid", linecolor: "--rule", zerolinecolor: "--rule", automargin,
    hoverformat: ".6~g", exponentformat: "power", minexponent: 5, ...own, title: {...own.title, standoff: 6}});
  // On a narrow page long titles are wrapped.
  const broken = (title, div) => div.clientWidth < 500 && title?.text ? {...title, text: title.text.replace(/(.{15}\S*) /g, "$1<br>")} : title;
  function figure(div) {
    const {data, layout} = specs.get(div);
    const full = {...layout, xaxis: axis({...layout.xaxis, title: broken(layout.xaxis.title, div)}, "bottom"), yaxis: axis(layout.yaxis, "left"),
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", margin: {l: 10, r: 30, t: 6, b: 8},
      modebar: {bgcolor: "rgba(0,0,0,0)", color: "--soft", activecolor: "--ink"},
      separators: ".\u2009", font: {family: "system-ui, sans-serif", size: 12, color: "--ink"},
      legend: {orientation: "h", x: 0, y: 1, yanchor: "bottom", font: {size: 12.5}},
      hovermode: layout.hovermode ?? (layout.yaxis.scaleanchor ? "closest" : "x unified"), dragmode: touch ? false : "zoom",
      hoverlabel: {bgcolor: "--wash", bordercolor: "--rule", font: {color: "--ink"}}};
    if (shown && linked.includes(div)) full.xaxis.range = shown;
    return [data, full].map(resolved);
  }

  async function draw(div) {
    const [data, layout] = figure(div);
    const first = !div.drawn;
    div.drawn = true;
    await Plotly.react(div, data, layout, {responsive: true, displaylogo: false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"]});
    div.dispatchEvent(new Event("drawn"));
    if (first && linked.includes(div)) div.on("plotly_relayout", change => {
      const ends = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
      if (ends[0] !== undefined) show(ends.map(Number), div);
      else if (change["xaxis.autorange"]) show(specs.get(div).layout.xaxis.range, null);
    });
    if (first && shown && linked.includes(div)) Plotly.relayout(div, ranges(div));
  }

  // The interval shown, and the range of the lines within it; for the whole run, the initial range of the plot.
  function ranges(div) {
    const own = specs.get(div).layout, [from, to] = shown;
    const change = {"xaxis.range": [from, to]};
    if (own.xaxis.range && from <= own.xaxis.range[0] && to >= own.xaxis.range[1]) {
      return Object.assign(change, own.yaxis.range ? {"yaxis.range": [...own.yaxis.range]} : {"yaxis.autorange": true});
    }
    const log = own.yaxis.type === "log";
    let least = Infinity, most = -Infinity;
    for (const {x, x0, dx, y, visible} of div._fullData) {
      if (visible !== true) continue;
      for (let i = 0; i < y.length; i++) {
        const at = x ? x[i] : x0 + i * dx;
        if (at < from || at > to || !Number.isFinite(y[i]) || log && y[i] <= 0) continue;
        least = Math.min(least, y[i]);
        most = Math.max(most, y[i]);
      }
    }
    if (least > most) return change;
    if (log) [least, most] = [Math.log10(least), Math.log10(most)];
    const margin = 0.06 * (most - least) || 0.05 * Math.abs(most) || 1;
    return Object.assign(change, {"yaxis.range": [least - margin, most + margin]});
  }

  // Shows this interval in all plots over time, including those drawn later.
  function show(ends, from) {
    if (!ends || shown && ends[0] === shown[0] && ends[1] === shown[1]) return;
    shown = [...ends];
    for (const div of linked) if (div !== from && div.drawn) Plotly.relayout(div, ranges(div));
  }
  for (const button of document.querySelectorAll("#views button"))
    button.addEventListener("click", () => show([Number(button.dataset.from), Number(button.dataset.to)], null));

  const watch = new IntersectionObserver(entries => {
    for (const {target, isIntersecting} of entries) if (isIntersecting) { watch.unobserve(target); draw(target); }
  }, {rootMargin: "800px"});
  plots.forEach(div => watch.observe(div));
  const redraw = () => plots.filter(div => div.drawn).forEach(draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  // A printed page is about 660 pixels wide, whatever the window, and laid out before plots can adapt.
  addEventListener("beforeprint", () => plots.forEach(div => {
    if (!div.drawn) draw(div);
    Plotly.relayout(div, {autosize: false, width: div.closest(".two") ? 320 : 650});
  }));
  addEventListener("afterprint", () => plots.forEach(div => Plotly.relayout(div, {autosize: true, width: null})));
})();
