/* Draws the figures of a report with Plotly, in the colours of the page and at its width, and plays shots back. */
(() => {
"use strict";
const given = JSON.parse(document.getElementById("figures").textContent);
const NARROW_PX = 560, LEGEND_LINE_PX = 19, PAPER_PX = 680, MARGIN = {l: 58, r: 12, t: 12, b: 50};
/* Nothing leaves the page: by default Plotly offers to upload a figure to its makers' server. */
const CONFIG = {displaylogo: false, modeBarButtonsToRemove: ["lasso2d", "select2d"], responsive: false,
  showSendToCloud: false, plotlyServerURL: ""};
const root = document.documentElement;

/* Colours written as var(--name) are the page's. */
function coloured(value, style) {
  if (typeof value === "string") {
    const found = /^var\((--[a-z-]+)\)$/.exec(value);
    return found ? style.getPropertyValue(found[1]).trim() : value;
  }
  if (Array.isArray(value)) return value.map((one) => coloured(one, style));
  if (value && typeof value === "object")
    return Object.fromEntries(Object.entries(value).map(([key, one]) => [key, coloured(one, style)]));
  return value;
}

function draw(chart) {
  const box = document.getElementById("chart-" + chart.name);
  if (!box || !box.clientWidth) return; // folded: drawn when it is opened
  const style = getComputedStyle(root), ink = style.getPropertyValue("--ink").trim();
  const line = style.getPropertyValue("--line").trim(), narrow = box.clientWidth < NARROW_PX;
  const own = coloured(chart.layout, style);
  const plotted = box.clientWidth - MARGIN.l - MARGIN.r;
  const axes = {};
  for (const name of ["xaxis", "yaxis"])
    axes[name] = {gridcolor: line, zerolinecolor: line, linecolor: line, ...own[name]};
  const layout = {
    font: {family: getComputedStyle(document.body).fontFamily, size: 12, color: ink}, margin: {...MARGIN},
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest", bargap: 0.05,
    hoverlabel: {bgcolor: style.getPropertyValue("--paper").trim(), font: {color: ink}},
    legend: {orientation: "h", x: 0, y: 1.02, yanchor: "bottom", font: {size: 11.5}}, ...own, ...axes,
    width: box.clientWidth, dragmode: narrow ? false : "zoom",
    height: chart.aspect ? Math.round(plotted * chart.aspect + MARGIN.t + MARGIN.b + 70) : chart.height,
  };
  if (chart.aspect) layout.margin.b = MARGIN.b + 70;
  const named = chart.data.filter((trace) => trace.name && trace.showlegend !== false).length;
  if (narrow && own.showlegend !== false && named > 1 && !chart.aspect) layout.height += LEGEND_LINE_PX * named;
  Plotly.react(box, coloured(chart.data, style), layout, {...CONFIG, displayModeBar: narrow ? false : "hover"});
}

/* Shots: the table from above in metres, y upwards. */
const UNSEEN = -32768, BEFORE = "#ff9f1c", AFTER = "#00e5ff"; // of the first model of two, and of the last
const SVG = "http://www.w3.org/2000/svg";

function summed(steps, unit) {
  let at = 0;
  return steps.map((step) => (at += step) / unit);
}

function element(parent, name, attributes) {
  const made = document.createElementNS(SVG, name);
  put(made, attributes);
  parent.appendChild(made);
  return made;
}

function put(mark, attributes) {
  for (const [key, value] of Object.entries(attributes)) mark.setAttribute(key, value);
}

function player(data) {
  const box = document.getElementById("player"), at = (name) => box.querySelector("[data-is=" + name + "]");
  const view = at("table"), time = at("time"), shotChoice = at("shot"), modelChoice = at("model");
  const magnifier = at("magnify"), said = at("said"), play = at("play"), pace = at("pace");
  const [length, width] = data.table, rim = 0.09;
  view.setAttribute("viewBox", [-length / 2 - rim, -width / 2 - rim, length + 2 * rim, width + 2 * rim].join(" "));
  const shape = (x, y, w, h, colour) => element(view, "rect", {x, y, width: w, height: h, fill: colour});
  shape(-length / 2 - rim, -width / 2 - rim, length + 2 * rim, width + 2 * rim, "#46301f");
  shape(-length / 2, -width / 2, length, width, "#125c3a");
  if (data.pockets)
    for (const x of [-1, 0, 1]) for (const y of [-1, 1])
      element(view, "circle", {cx: x * length / 2, cy: y * width / 2, r: 0.045, fill: "#0b0d0e"});
  const layer = element(view, "g", {transform: "scale(1,-1)"});
  data.shots.forEach((shot, k) => {
    const held = shot.held ? ", held out" : "";
    shotChoice.add(new Option(shot.name + ": misses by " + shot.misses.join(", then ") + held, k));
  });
  const every = data.models.map((_, k) => k), colour = (k) => k + 1 < every.length ? BEFORE : AFTER;
  if (every.length > 1) modelChoice.add(new Option("before and after", every.join()));
  data.models.forEach((name, k) => modelChoice.add(new Option(name, k)));
  magnifier.value = data.magnify;
  modelChoice.parentNode.hidden = data.models.length < 2;
  let balls = [], end = 0, now = 0, running = 0;

  function load() {
    layer.replaceChildren();
    const shot = data.shots[shotChoice.value], shown = modelChoice.value.split(","), times = +magnifier.value;
    const even = {"vector-effect": "non-scaling-stroke"}, path = {fill: "none", "stroke-width": 2, ...even};
    const points = (keep, px, py) => keep.map((k) => px(k).toFixed(4) + "," + py(k).toFixed(4)).join(" ");
    balls = shot.balls.map((ball) => {
      const t = summed(ball.t, 1e3), x = summed(ball.x, 1e4), y = summed(ball.y, 1e4);
      element(layer, "polyline", {...path, stroke: ball.colour, points: points(t.map((_, k) => k), (k) => x[k], (k) => y[k])});
      const models = shown.map((which) => {
        const [dx, dy] = ball.miss[which].map((part) => part.map((v) => v === UNSEEN ? NaN : v / 1e4));
        const seen = t.map((_, k) => k).filter((k) => Number.isFinite(dx[k])), stroke = colour(+which);
        element(layer, "polyline", {...path, stroke, "stroke-width": 1.3, "stroke-dasharray": "5 3",
          points: points(seen, (k) => x[k] + times * dx[k], (k) => y[k] + times * dy[k])});
        return {dx, dy, link: element(layer, "line", {stroke, "stroke-width": 1.3, ...even}),
          ring: element(layer, "circle", {...path, r: 1.15 * data.radius, stroke})};
      });
      const disc = element(layer, "circle", {r: data.radius, fill: ball.colour, stroke: "#10151a", "stroke-width": 0.004});
      return {name: ball.name, t, x, y, models, disc};
    });
    end = Math.max(...balls.map((ball) => ball.t[ball.t.length - 1]));
    time.max = end;
    show(Math.min(now, end));
  }

  /* Between two samples a ball is on the line from one to the next; before the first and after the last it rests. */
  function value(ball, list, t) {
    let k = ball.t.findIndex((one) => one > t);
    if (k < 0) return list[list.length - 1];
    if (k === 0) return list[0];
    const part = (t - ball.t[k - 1]) / (ball.t[k] - ball.t[k - 1]);
    return list[k - 1] + part * (list[k] - list[k - 1]);
  }

  function show(t) {
    now = t;
    time.value = t;
    const words = [];
    for (const ball of balls) {
      const [x, y] = [ball.x, ball.y].map((list) => value(ball, list, t)), times = +magnifier.value, sizes = [];
      put(ball.disc, {cx: x, cy: y});
      for (const {dx, dy, link, ring} of ball.models) {
        const [a, b] = [dx, dy].map((list) => value(ball, list, t)), known = Number.isFinite(a) && Number.isFinite(b);
        const [rx, ry] = known ? [x + times * a, y + times * b] : [x, y];
        put(ring, {cx: rx, cy: ry});
        put(link, {x1: x, y1: y, x2: rx, y2: ry});
        ring.style.display = known ? "" : "none";
        if (known) sizes.push((1e3 * Math.hypot(a, b)).toFixed(1) + " mm");
      }
      if (sizes.length && ball.t.length > 2) words.push(ball.name + " misses by " + sizes.join(", then "));
    }
    said.textContent = t.toFixed(2) + " s" + (words.length ? ": " + words.join(", ") : "");
  }

  function stop() {
    cancelAnimationFrame(running);
    running = 0;
    play.textContent = "Play";
  }

  play.addEventListener("click", () => {
    if (running) return stop();
    if (now >= end) now = 0;
    play.textContent = "Pause";
    let before = performance.now();
    const step = (at) => {
      show(Math.min(end, now + (at - before) / 1e3 * +pace.value));
      before = at;
      if (now >= end) return stop();
      running = requestAnimationFrame(step);
    };
    running = requestAnimationFrame(step);
  });
  time.addEventListener("input", () => { stop(); show(+time.value); });
  shotChoice.addEventListener("change", () => { stop(); now = Infinity; load(); });
  for (const choice of [modelChoice, magnifier]) choice.addEventListener("change", load);
  now = Infinity;
  load();
}

const drawAll = () => given.charts.forEach(draw);
drawAll();
if (given.player) player(given.player);
for (const folded of document.querySelectorAll("details")) folded.addEventListener("toggle", drawAll);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawAll);
let waiting = 0, before = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === before) return;
  before = innerWidth;
  clearTimeout(waiting);
  waiting = setTimeout(drawAll, 120);
});
addEventListener("beforeprint", () => { root.classList.add("paper"); drawAll(); });
addEventListener("afterprint", () => { root.classList.remove("paper"); drawAll(); });
root.dataset.drawn = "yes";
})();
