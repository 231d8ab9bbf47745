"use strict";
// Charts by uPlot from the numbers in the page: lines by channel, time axes that move together.
(() => {
  const GAP = 65535;
  const records = JSON.parse(document.getElementById("data")?.textContent || "[]");
  if (!records.length) return;
  const holders = [...document.querySelectorAll(".chart")];
  const [byRecord, byChannel] = ["pick-record", "pick-channel"].map((id) => document.getElementById(id));
  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim();
  const short = (v) => (v == null ? "–" : v && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5) ? v.toExponential() : String(v));
  const digits = (v) => short(v == null ? v : Number(v.toPrecision(4)));
  let charts = [];

  function numbers(line, log) {
    const bytes = Uint8Array.from(atob(line.codes), (c) => c.charCodeAt(0));
    const step = (line.high - line.low) / (GAP - 1);
    return Array.from(new Uint16Array(bytes.buffer), (c) => (c === GAP ? null : log ? 10 ** (line.low + c * step) : line.low + c * step));
  }

  function decades(u, axis, low, high) {
    const [first, last] = [Math.ceil(Math.log10(low)), Math.floor(Math.log10(high))];
    const each = Math.ceil((last - first + 1) / 6);
    return Array.from({ length: Math.floor((last - first) / each) + 1 }, (_, k) => 10 ** (first + k * each));
  }

  function options(chart, place, width) {
    const axis = { stroke: colour("fg"), grid: { stroke: colour("line"), width: 1 }, ticks: { stroke: colour("line") }, font: "13px system-ui, sans-serif", labelFont: "13px system-ui, sans-serif" };
    const style = { measured: { width: 3 }, own: { width: 1.2 }, plain: { width: 1.2, dash: [5, 3] } };
    const lines = chart.lines.map((l) => ({
      label: l.label, stroke: colour(l.role), ...style[l.role], points: { show: false }, value: (_, v) => digits(v),
    }));
    return {
      width, height: place === 0 ? 280 : 200, scales: { x: { time: false }, y: { distr: chart.log ? 3 : 1 } },
      series: [{ label: chart.x, value: (_, v) => digits(v) }, ...lines],
      axes: [{ ...axis, label: chart.x, labelSize: 20, size: 34 }, { ...axis, label: chart.y, labelSize: 20, size: 66, ...(chart.log ? { splits: decades, filter: (_, all) => all } : {}), values: (_, all) => all.map(digits) }],
      cursor: { drag: { x: true, y: false }, ...(chart.time ? { sync: { key: "time" } } : {}) },
      hooks: { setScale: [(u, key) => key === "x" && chart.time && follow(u)] },
    };
  }

  let following = false; // one chart moves the others, which do not move it again
  function follow(moved) {
    if (following) return;
    following = true;
    const { min, max } = moved.scales.x;
    for (const u of charts) if (u !== moved && u.time) u.setScale("x", { min, max });
    following = false;
  }

  function draw() {
    const shown = records[byRecord.value].channels[byChannel.value].charts;
    charts.forEach((u) => u.destroy());
    charts = [];
    following = true;
    shown.forEach((chart, i) => {
      const lines = chart.lines.map((line) => numbers(line, chart.log));
      const x = lines[0].map((_, k) => chart.start + k * chart.step);
      const u = new uPlot(options(chart, i, holders[i].clientWidth), [x, ...lines], holders[i]);
      u.time = chart.time;
      for (const head of holders[i].querySelectorAll("th")) head.scope = "row";
      u.whole = { min: x[0], max: x[x.length - 1] };
      charts.push(holders[i].chart = u);
    });
    following = false;
  }

  function move(u, what) {
    const { min, max } = u.scales.x, middle = (min + max) / 2, half = (max - min) / 2;
    const to = { in: [middle, half / 2], out: [middle, half * 2], left: [middle - half, half], right: [middle + half, half], all: [0, Infinity] }[what];
    const size = Math.min(to[1], (u.whole.max - u.whole.min) / 2); // never beyond the record
    const centre = Math.min(Math.max(to[0], u.whole.min + size), u.whole.max - size);
    u.setScale("x", { min: centre - size, max: centre + size });
  }

  const fill = (list, names) => list.replaceChildren(...names.map((name, i) => new Option(name, i)));
  fill(byRecord, records.map((r) => r.name));
  fill(byChannel, records[0].channels.map((c) => c.name));
  for (const list of [byRecord, byChannel]) {
    list.parentElement.hidden = list.length < 2;
    list.addEventListener("change", draw);
  }
  document.getElementById("tools").hidden = false;
  for (const button of document.querySelectorAll("[data-do]")) button.addEventListener("click", () => move(charts[0], button.dataset.do));
  const keys = { "+": "in", "=": "in", "-": "out", ArrowLeft: "left", ArrowRight: "right", 0: "all" };
  for (const holder of holders)
    holder.addEventListener("keydown", (event) => {
      if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
      event.preventDefault();
      move(holder.chart, keys[event.key]);
    });
  new ResizeObserver(() => charts.forEach((u, i) => holders[i].clientWidth !== u.width && u.setSize({ width: holders[i].clientWidth, height: u.height }))).observe(holders[0]);
  for (const media of ["(prefers-color-scheme: dark)", "print"]) matchMedia(media).addEventListener("change", draw); // other colours
  draw();
})();
