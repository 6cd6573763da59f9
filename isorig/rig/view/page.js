"use strict";
(() => {
  const colours = {
    light: ["#0b62a8", "#c4481c", "#12805c", "#8b4fb3", "#a87900", "#b8336a", "#30363c", "#5b7083"],
    dark: ["#6cb6f0", "#ff8f5e", "#4fcf9f", "#c79bea", "#e3bd4a", "#f084ae", "#dfe3e6", "#93a9bd"],
  };
  const phases = {
    begins: ["starting", ""], asks: ["waiting for you", "ask"], checks: ["pre-run check", "on"], measures: ["measuring", "on"],
    quiet: ["no new sample", "quiet"], finishes: ["waiting for you", "ask"], over: ["ended", ""],
  };
  const root = document.documentElement;
  const at = (id) => document.getElementById(id);
  const dark = () => (root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches);
  const drawn = { frames: 0, values: 0 };
  let socket = null, state = null, plots = {}, pressed = "";

  // ------------------------------------------------------------------ words
  const put = (id, text) => { const node = at(id); if (node.textContent !== text) node.textContent = text; };
  const make = (kind, name, text) => { const node = document.createElement(kind); if (name) node.className = name; if (text !== undefined) node.textContent = text; return node; };
  const figure = (value) => (value === 0 ? "0" : Math.abs(value) >= 1000 || Math.abs(value) < 0.001 ? value.toExponential(1) : String(+value.toPrecision(3)));
  const clock = (seconds) => { const s = Math.max(Math.ceil(seconds), 0), m = Math.floor(s / 60); return m >= 60 ? `${Math.floor(m / 60)} h ${m % 60} min` : m ? `${m} min ${s % 60} s` : `${s} s`; };

  function words() {
    put("title", state.title);
    document.title = `${state.title}: rig`;
    const [shown, kind] = phases[state.phase];
    const replayed = state.mode === "replay" ? "replay, " : "";
    put("phase", replayed + shown);
    at("phase").className = `chip ${kind}`;
    const run = state.run;
    put("run", run ? `Run ${run.number}${run.count ? ` of ${run.count}` : ""}: ${run.id}, ${run.set_up ? `${run.set_up}, ` : ""}gain ${figure(run.gain)}` : "No run has started.");
    at("part").value = run && run.of ? Math.min(run.seconds / run.of, 1) : 0;
    const left = [];
    if (run && state.phase === "measures" && run.count) left.push(`${clock(run.of - run.seconds)} left of the run`);
    if (run && !run.count) left.push(`${clock(run.seconds)} measured`);
    if (state.session_left !== null && state.phase !== "over") left.push(`${clock(state.session_left)} of measuring time left in the session`);
    put("left", left.join(", "));
    put("text", state.text);
    put("verdict", state.verdict);
    put("averaged", state.averaged);
    put("isolated", state.isolated);
    // A rig with a single configuration has no such ratio.
    at("ratio").hidden = !state.isolated;
    at("equations").hidden = !state.equations;
    if (state.equations) {
      put("told", state.equations.text);
      list("residuals", state.equations.bars, (bar) => equation(bar, state.equations.limit));
    }
    list("advice", state.advice, (line) => make("li", "", line));
    list("notes", [...state.notes].reverse(), (note) => {
      const item = make("li");
      item.append(make("time", "", new Date(note.time).toLocaleTimeString()), `${note.run ? `${note.run}: ` : ""}${note.text}`);
      return item;
    });
    at("noted").hidden = !state.notes.length;
    const losses = [`lost ${state.lost}`];
    if (state.damaged) losses.push(`damaged in transmission ${state.damaged}`);
    if (state.overloads) losses.push(`the instrument reported ${state.overloads} overloads`);
    put("sum", state.shown ? `${state.shown}: ${losses.join(", ")}` : "");
    at("session").classList.toggle("alone", state.runs.every((run) => !run.set_up));
    list("runs", state.runs, row);
  }

  // Residual over noise on a logarithmic scale from 0.1 to 10 000; the mark is the limit up to which an equation holds.
  const above = (value) => Math.min(Math.max((1 + Math.log10(Math.max(value, 1e-9))) / 5, 0.01), 1) * 100;
  function equation(bar, most) {
    const box = make("div", `equation ${bar.residual < most ? "" : "broken"}`), track = make("div", "bar"), share = make("div", "rms"), limit = make("div", "limit");
    share.style.width = `${above(bar.residual)}%`;
    limit.style.left = `${above(most)}%`;
    track.append(share, limit);
    track.title = "residual over noise, logarithmic from 0.1 to 10 000; the mark is the limit up to which the equation holds";
    box.append(make("span", "name", bar.name), make("span", "figures", `${figure(bar.residual)} times the noise`), track);
    return box;
  }

  function row(run) {
    const line = make("tr", `${run.state === "now" ? "now" : ""} ${run.good ? "" : "bad"}`);
    const status = { planned: "planned", now: "measuring", stopped: "stopped", taken: run.good ? "measured" : "repeat" }[run.state];
    for (const cell of [run.id, run.set_up, figure(run.gain), figure(run.of), String(run.lost)]) line.append(make("td", "", cell));
    line.append(make("td", "status", [status, ...run.advice].join(" · ")));
    return line;
  }

  const before = {};
  function list(id, items, build) {
    const key = JSON.stringify(items);
    if (before[id] === key) return;
    before[id] = key;
    at(id).replaceChildren(...items.map(build));
  }

  // ------------------------------------------------------------------ levels
  // A level meter in decibels: -60 dB (a thousandth of the range) to the left, full scale to the right.
  const place = (share) => Math.min(Math.max(1 + Math.log10(Math.max(share, 1e-9)) / 3, 0), 1) * 100;
  const rows = new Map();

  function channelRow(name) {
    const box = make("div", "channel"), head = make("div", "head");
    const parts = { over: make("span", "over"), figures: make("div", "figures"), fresh: make("span", "figures fresh"), bar: make("div", "bar"), trace: make("div", "trace") };
    head.append(make("span", "name", name), parts.over, parts.fresh);
    for (const kind of ["peak", "rms", "held"]) parts.bar.append((parts[kind] = make("div", kind)));
    for (const share of state.limits) { const limit = make("div", "limit"); limit.style.left = `${place(share)}%`; parts.bar.append(limit); }
    parts.bar.title = "rms and peak of the last second and the highest peak, in dB of the range; the marks are the limits for advice";
    parts.fresh.title = "age of the last sample, and samples lost in this run";
    box.append(head, parts.figures, parts.bar, parts.trace);
    parts.box = box;
    return parts;
  }

  function levels() {
    const names = state.channels.map((channel) => channel.name);
    if (names.join() !== [...rows.keys()].join()) {
      rows.clear();
      for (const name of names) rows.set(name, channelRow(name));
      at("channels").replaceChildren(...[...rows.values()].map((parts) => parts.box));
      drop("time");
    }
    for (const channel of state.channels) {
      const parts = rows.get(channel.name), unit = channel.unit.replace("^2", "²");
      const share = channel.full ? channel.held / channel.full : null;
      parts.over.hidden = !channel.over.length;
      parts.over.textContent = `OVER in ${channel.over.join(", ")}`;
      parts.figures.textContent = `rms ${figure(channel.rms)}, peak ${figure(channel.peak)}, highest ${figure(channel.held)} ${unit}`
        + (share === null ? ", range unknown" : `, ${figure(100 * share)} % of range`);
      parts.fresh.textContent = state.age === null ? "" : `last sample ${state.age.toFixed(1)} s ago, lost ${state.lost}`;
      parts.bar.hidden = share === null;
      if (share === null) continue;
      parts.rms.style.width = `${place(channel.rms / channel.full)}%`;
      parts.peak.style.width = `${place(channel.peak / channel.full)}%`;
      parts.held.style.left = `calc(${place(share)}% - 2px)`;
      parts.bar.className = `bar ${channel.over.includes(state.shown) ? "full" : share > state.limits[1] ? "near" : ""}`;
    }
  }

  // ------------------------------------------------------------------ plots
  const charts = new Map();  // by the plot's name: [{ chart, box }]
  const stroke = (k) => colours[dark() ? "dark" : "light"][k % 8];
  // A channel has one colour in all plots.
  const strokeOf = (name, k) => { const place = [...rows.keys()].indexOf(name); return stroke(place < 0 ? k : place); };
  const ink = () => getComputedStyle(root).getPropertyValue("--soft").trim();
  const grid = () => getComputedStyle(root).getPropertyValue("--line").trim();
  const axis = (more) => ({ stroke: ink(), grid: { stroke: grid(), width: 1 }, ticks: { stroke: grid(), width: 1, size: 4 }, font: "11px system-ui, sans-serif", ...more });
  const short = (u, splits) => splits.map((v) => (v === null || v === undefined ? "" : Math.abs(v) >= 1e4 || (v !== 0 && Math.abs(v) < 1e-3) ? v.toExponential(0) : String(+v.toPrecision(3))));
  const linked = uPlot.sync("frequency");

  function drop(name) {
    for (const { chart, watcher } of charts.get(name) ?? []) { watcher.disconnect(); chart.destroy(); }
    charts.delete(name);
  }

  function chartIn(box, height, options, data) {
    box.classList.remove("empty");
    const size = () => ({ width: Math.max(box.clientWidth, 80), height });
    const chart = new uPlot({ ...size(), pxAlign: 0, ...options }, data, box);
    const watcher = new ResizeObserver(() => { if (chart.width !== size().width) chart.setSize(size()); });
    watcher.observe(box);
    return { chart, watcher };
  }

  const part = (plot, k) => plot.numbers.subarray(k * plot.points, (k + 1) * plot.points);
  // NaN is a frequency bin without a value.
  const gaps = (values) => Array.from(values, (v) => (Number.isFinite(v) ? v : null));

  function time(plot) {
    const data = plot.names.map((_, k) => [part(plot, 0), part(plot, k + 1)]);
    if (!charts.has("time")) {
      charts.set("time", plot.names.map((name, k) => chartIn(rows.get(name).trace, k === plot.names.length - 1 ? 88 : 70, {
        legend: { show: false }, cursor: { show: false }, padding: [6, 12, 2, 0],
        scales: { x: { time: false, range: (u, low, high) => [Math.max(high - 4, low), Math.max(high, low + 0.1)] } },
        axes: [axis({ size: 20, show: k === plot.names.length - 1, values: (u, v) => v.map((s) => `${+s.toFixed(2)} s`) }), axis({ size: 46, space: 14, values: short })],
        series: [{}, { label: name, stroke: stroke(k), width: 1, points: { show: false } }],
      }, data[k])));
    } else charts.get("time").forEach(({ chart }, k) => chart.setData(data[k]));
  }

  // An uncertainty band down to zero would extend a logarithmic axis without limit.
  const edges = (value, std, log) => [value.map((v, i) => (v === null ? null : v + std[i])), value.map((v, i) => (v === null ? null : log ? Math.max(v - std[i], v / 3) : v - std[i]))];

  function banded(plot, step, first, log) {
    const data = [Array.from(part(plot, 0))];
    plot.names.forEach((_, k) => {
      const value = gaps(part(plot, 1 + step * k + first)), std = part(plot, 2 + step * k + first);
      data.push(value, ...edges(value, std, log));
    });
    return data;
  }

  function bandedChart(box, height, plot, title, { log, range, splits, legend }, data) {
    const none = (v) => v === null || v === undefined, series = [{ label: "at the cursor, Hz", value: (u, v) => (none(v) ? "–" : figure(v)) }], bands = [];
    plot.names.forEach((name, k) => {
      const edge = { class: "edge", stroke: "transparent", width: 0, points: { show: false } };
      series.push({ label: name, stroke: strokeOf(name, k), width: 1.5, points: { show: false }, value: (u, v) => (none(v) ? "–" : figure(v)) }, { ...edge, label: `${name} high` }, { ...edge, label: `${name} low` });
      bands.push({ series: [3 * k + 2, 3 * k + 3], fill: strokeOf(name, k) + "38" });
    });
    return chartIn(box, height, {
      title, series, bands, legend: { show: legend, live: legend }, cursor: { sync: { key: linked.key }, y: false, drag: { x: false, y: false } },
      scales: { x: { time: false, distr: 3, range: (u, low, high) => [low, high] }, y: { distr: log ? 3 : 1, ...(range && { range }) } },
      axes: [axis({ size: 26, values: short }), axis({ size: 52, values: short, ...(splits && { splits }) })],
      hooks: { setSeries: [(u, i, o) => { if (i && (i - 1) % 3 === 0 && o.show !== undefined) for (const k of [i + 1, i + 2]) u.setSeries(k, { show: o.show }, false); }] },
    }, data);
  }

  function plain(plot) {
    const data = [Array.from(part(plot, 0))];
    plot.names.forEach((_, k) => data.push(gaps(part(plot, 1 + 5 * k + 4))));
    return data;
  }

  function units(chosen) { return [...new Set(state.channels.filter(({ name }) => chosen(name)).map(({ unit }) => unit.replace("^2", "²")))].join(" or "); }

  // What the magnitude is: the unit of the responses per that of the drive, which is the channel that is no response.
  function magnitude(names) {
    const over = units((name) => names.includes(name)), by = units((name) => !names.includes(name));
    return !over || !by || by.includes(" or ") || over === by ? "magnitude relative to the drive" : `magnitude, ${over} per ${by}`;
  }

  const wanted = new Map();  // the names that a chart was made for: other names need another chart
  function frf(plot) {
    const sets = [banded(plot, 5, 0, true), banded(plot, 5, 2, false), plain(plot)];
    if (wanted.get("frf") !== plot.names.join()) drop("frf");
    wanted.set("frf", plot.names.join());
    if (charts.has("frf")) { charts.get("frf").forEach(({ chart }, k) => chart.setData(sets[k])); return; }
    const series = [{ label: "Hz" }, ...plot.names.map((name, k) => ({ label: name, stroke: strokeOf(name, k), width: 1.5, points: { show: false } }))];
    charts.set("frf", [
      bandedChart(at("magnitude"), 240, plot, `${magnitude(plot.names)}, with one standard deviation`, { log: true, legend: true }, sets[0]),
      bandedChart(at("phases"), 140, plot, "phase, degrees", { range: [-190, 190], splits: () => [-180, -90, 0, 90, 180] }, sets[1]),
      chartIn(at("coherence"), 150, {
        title: "coherence", series, legend: { show: false }, cursor: { sync: { key: linked.key }, y: false, drag: { x: false, y: false } },
        scales: { x: { time: false, distr: 3, range: (u, low, high) => [low, high] }, y: { range: [0, 1.02] } },
        axes: [axis({ size: 34, values: short, label: "frequency, Hz", labelSize: 14, labelFont: "11px system-ui, sans-serif" }), axis({ size: 52, values: short, splits: () => [0, 0.5, 1] })],
      }, sets[2]),
    ]);
  }

  function isolation(plot) {
    const data = banded(plot, 2, 0, true);
    if (wanted.get("isolation") !== plot.names.join()) drop("isolation");
    wanted.set("isolation", plot.names.join());
    if (charts.has("isolation")) charts.get("isolation")[0].chart.setData(data);
    else charts.set("isolation", [bandedChart(at("isolation"), 240, plot, "ratio, with one standard deviation, over frequency in Hz", { log: true, legend: true }, data)]);
  }

  const drawers = { time, frf, isolation };
  function draw(fresh) {
    words();
    levels();
    controls();
    let values = 0;
    for (const name of fresh) {
      drawers[name](plots[name]);
      values += plots[name].numbers.length;
    }
    for (const [id, name] of [["magnitude", "frf"], ["phases", "frf"], ["coherence", "frf"], ["isolation", "isolation"]]) at(id).classList.toggle("empty", !plots[name]);
    drawn.frames += 1;
    drawn.values += values;
    root.dataset.frames = drawn.frames;
    root.dataset.values = drawn.values;
    return values;
  }

  function redraw() {
    for (const name of [...charts.keys()]) drop(name);
    if (state) draw(Object.keys(plots));
  }

  // ------------------------------------------------------------------ the socket
  function read(message) {
    const length = new DataView(message).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(message, 4, length)));
    const numbers = new Float32Array(message, 4 + length);
    for (const [name, about] of Object.entries(head.plots))
      plots[name] = { ...about, numbers: numbers.subarray(about.at, about.at + about.rows * about.points) };
    return head;
  }

  const say = (what) => { if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(what)); };

  function connect() {
    if (socket && socket.readyState <= WebSocket.OPEN) return;
    const own = new WebSocket(`${location.href.split(/[?#]/)[0].replace(/^http/, "ws")}live`);
    socket = own;
    own.binaryType = "arraybuffer";
    own.onmessage = (event) => requestAnimationFrame(() => {
      const head = read(event.data);
      state = head.state;
      say({ say: "drawn", frame: head.frame, values: draw(Object.keys(head.plots)) });
    });
    own.onclose = () => {
      if (own !== socket) return;
      const ended = state && state.phase === "over";
      put("phase", ended ? "ended" : "not connected");
      at("phase").className = ended ? "chip" : "chip bad";
      if (state) { state.may = []; controls(); }
      if (!ended && !document.hidden) setTimeout(connect, 1000);
    };
  }

  // ------------------------------------------------------------------ buttons
  function controls() {
    const may = new Set(state.may), asked = `${state.phase} ${state.asked} ${state.may}`;
    if (pressed !== asked) pressed = "";
    at("actions").hidden = state.mode !== "session";
    const waits = state.phase === "asks" || state.phase === "finishes";
    put("next", state.phase === "finishes" ? "Finish the session" : `Start ${state.asked}`);
    put("again", waits && state.last ? `Repeat ${state.last}` : "Repeat this run");
    for (const id of ["next", "stop", "again"]) at(id).disabled = !may.has(id) || pressed !== "";
    at("next").hidden = !may.has("next");
    at("stop").hidden = waits;
    at("again").hidden = waits && !may.has("again");
    at("note").querySelectorAll("*").forEach((node) => { node.disabled = !may.has("note"); });
  }

  for (const id of ["next", "stop", "again"])
    at(id).addEventListener("click", () => {
      say({ say: "asked", do: id, run: state.asked });
      pressed = `${state.phase} ${state.asked} ${state.may}`;
      controls();
    });
  at("note").addEventListener("submit", (event) => {
    event.preventDefault();
    const text = at("words").value.trim();
    if (text) say({ say: "asked", do: "note", run: state.asked, text });
    at("words").value = "";
  });
  at("theme").addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; redraw(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  document.addEventListener("visibilitychange", () => { if (!document.hidden) connect(); });
  connect();
})();
