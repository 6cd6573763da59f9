"use strict";
(() => {
  const charts = JSON.parse(document.getElementById("data").textContent);
  const colours = {
    light: { measured: "#30363c", simulated: "#c4481c", extended: "#0b62a8", noise: "#9aa1a8",
      first: "#0b62a8", second: "#c4481c", third: "#12805c", fourth: "#8b4fb3", fifth: "#a87900", sixth: "#b8336a" },
    dark: { measured: "#dfe3e6", simulated: "#ff8f5e", extended: "#6cb6f0", noise: "#78818a",
      first: "#6cb6f0", second: "#ff8f5e", third: "#4fcf9f", fourth: "#c79bea", fifth: "#e3bd4a", sixth: "#f084ae" },
  };
  const root = document.documentElement;
  const dark = () => root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  const place = (number) => document.getElementById(`chart${number}`);
  const numbers = (box) => {
    if (Array.isArray(box)) return box;
    const bytes = Uint8Array.from(atob(box.bdata), (c) => c.charCodeAt(0));
    return Array.from(new Float32Array(bytes.buffer));
  };
  function unpack(chart) {
    for (const trace of chart.traces) {
      for (const key of ["x", "y", "spread"]) if (trace[key]) trace[key] = numbers(trace[key]);
      if (chart.x_date) trace.x = trace.x.map(moment);
    }
  }

  const moment = (days) => (Number.isFinite(days) ? new Date(days * 864e5).toISOString() : null);
  const across = (chart, x) => (chart.x_date ? moment(x) : x);
  const axis = (panel) => (panel ? `y${panel + 1}` : "y");
  const ends = (pair, log) => (log ? pair.map(Math.log10) : pair);
  const faded = (colour) => colour + "38";

  function traces(chart, theme) {
    const seen = new Set(), out = [];
    for (const t of chart.traces) {
      const colour = colours[theme][t.role];
      const base = { yaxis: axis(t.panel), legendgroup: t.name, name: t.name, hoverlabel: { namelength: -1 } };
      if (t.spread && t.style !== "points") {
        const log = chart.panels[t.panel].log;  // a band that reaches zero would open the axis to nowhere
        const hidden = { ...base, type: "scatter", mode: "lines", line: { width: 0 }, showlegend: false, hoverinfo: "skip", x: t.x };
        out.push({ ...hidden, y: t.y.map((v, i) => log ? Math.max(v - t.spread[i], v / 3) : v - t.spread[i]) });
        out.push({ ...hidden, y: t.y.map((v, i) => v + t.spread[i]), fill: "tonexty", fillcolor: faded(colour) });
      }
      const first = !seen.has(t.name);
      seen.add(t.name);
      if (t.style === "bars") {
        out.push({ ...base, type: "bar", orientation: "h", x: t.y, y: t.x, marker: { color: colour }, showlegend: first,
          text: t.y.map((v) => (Number.isFinite(v) ? Number(v.toPrecision(2)).toString() : "")), textposition: "outside", cliponaxis: false, hoverinfo: "x+name" });
      } else {
        const dots = t.style === "dots", points = dots || t.style === "markers" || t.style === "points";
        out.push({ ...base, type: "scatter", mode: points ? "markers" : "lines", x: t.x, y: t.y, showlegend: first,
          line: { color: colour, width: 1.5, dash: points ? "solid" : t.style }, marker: { color: colour, size: dots ? 3 : 6, opacity: dots ? 0.45 : 1 }, ...(dots ? { hoverinfo: "skip" } : {}),
          ...(t.style === "points" && t.spread ? { error_y: { type: "data", array: t.spread, color: colour, thickness: 1, width: 0 } } : {}) });
      }
    }
    return out;
  }

  function reach(chart, panel) {
    let low = Infinity, high = 0;
    for (const t of chart.traces) if (t.panel === panel) for (const v of t.y) if (v > 0) { low = Math.min(low, v); high = Math.max(high, v); }
    return [low, high];
  }
  // Over few decades the powers of ten alone would leave an axis without numbers.
  function decades(low, high) {
    const small = { minor: { dtick: "D1", ticks: "outside", ticklen: 3, showgrid: false } };
    return high / low < 2000 ? { dtick: "D2", tickformat: high < 1e5 && low > 1e-4 ? "~g" : ".0e", ...small } : { dtick: 1, exponentformat: "power", ...small };
  }

  // Lines of a bar's name, of two fifths of a chart's width at most; a longer word is broken.
  function lines(text, width) {
    const most = Math.max(12, Math.floor((0.4 * width) / (width < 560 ? 6 : 7)));
    return text.match(new RegExp(`.{1,${most}}(?:\\s+|$)|\\S{${most}}`, "g")) ?? [text];
  }

  function layout(chart, theme, narrow, width, space) {
    const ink = theme === "dark" ? "#e6e8ea" : "#1c2024", line = theme === "dark" ? "#33393f" : "#d9dce0";
    const style = { color: ink, gridcolor: line, zerolinecolor: line, linecolor: line, ticks: "outside", automargin: true };
    const total = chart.panels.reduce((sum, p) => sum + p.height, 0), gap = 0.05;
    const bars = chart.traces.some((t) => t.style === "bars");
    const out = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", uirevision: "keep", barmode: "group",
      modebar: { bgcolor: "rgba(0,0,0,0)", color: theme === "dark" ? "#78818a" : "#9aa1a8", activecolor: ink },
      font: { family: "system-ui, sans-serif", size: narrow ? 11 : 13, color: ink },
      ...(width ? { width } : { autosize: true }),
      margin: { l: narrow ? 46 : 62, r: 20, t: narrow ? 30 : 56, b: 44 }, hovermode: bars ? "closest" : "x unified", hoverlabel: { bgcolor: theme === "dark" ? "#20252a" : "#fff" },
      legend: { orientation: "h", x: 0, y: 1.02, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)" },
      showlegend: new Set(chart.traces.map((t) => t.name)).size > 1, hoversubplots: "axis",
      xaxis: { ...style, title: { text: chart.x_label, standoff: 6 }, type: chart.x_log ? "log" : "linear", anchor: axis(chart.panels.length - 1),
        showspikes: !bars, spikemode: "across", spikesnap: "cursor", spikethickness: 1, spikedash: "dot", spikecolor: ink },
    };
    if (chart.x_date) out.xaxis.type = "date";
    out.shapes = chart.marks.map((m) => ({ type: "rect", xref: "x", yref: `${axis(m.panel)} domain`, x0: across(chart, m.begin), x1: across(chart, m.end),
      y0: 0, y1: 1, line: { width: 0 }, fillcolor: faded(colours[theme].second), layer: "below" }));
    if (chart.x_log) Object.assign(out.xaxis, { dtick: "D2", tickformat: "~g", minor: { dtick: "D1", ticks: "outside", ticklen: 3, showgrid: false } });
    if (chart.x_ends) out.xaxis.range = ends(chart.x_ends, chart.x_log);
    let top = 1;
    chart.panels.forEach((p, i) => {
      const height = ((1 - gap * (chart.panels.length - 1)) * p.height) / total;
      const y = { ...style, title: { text: p.label.replaceAll("\n", "<br>"), standoff: 4 }, type: p.log ? "log" : "linear", domain: [Math.max(top - height, 0), top] };
      if (p.log) Object.assign(y, decades(...reach(chart, i)));
      if (p.ends) y.range = ends(p.ends, p.log);
      if (p.step) y.dtick = p.step;
      out[i ? `yaxis${i + 1}` : "yaxis"] = y;
      top -= height + gap;
    });
    if (bars) {
      const names = chart.traces[0].x;
      Object.assign(out.yaxis, { type: "category", autorange: "reversed", title: {}, ticks: "",
        tickmode: "array", tickvals: names, ticktext: names.map((name) => lines(name, space).join("<br>")) });
      out.xaxis.anchor = "y";
      const [low, high] = reach(chart, 0);
      // The number at the end of the longest bar takes up to a fifth of the axis.
      const most = high * Math.max(2, (high / low) ** 0.25);
      if (chart.x_log) Object.assign(out.xaxis, decades(low / 3, most), { range: [Math.log10(low / 3), Math.log10(most)] });
    }
    return out;
  }

  function draw(number, theme = dark() ? "dark" : "light", width = 0) {
    const div = place(number);
    const narrow = div.clientWidth < 560;
    // A legend of several rows takes no height from the panels.
    const names = [...new Set(charts[number].traces.map((t) => t.name))];
    const space = width || div.clientWidth;
    if (charts[number].traces[0].style === "bars") {
      const bars = charts[number].traces[0].x;
      div.style.setProperty("--lines", bars.length * Math.max(...bars.map((name) => lines(name, space).length)));
    }
    const per = Math.max(1, Math.floor((div.clientWidth - 80) / (45 + (narrow ? 5.5 : 7) * Math.max(...names.map((n) => n.length)))));
    div.style.setProperty("--rows", Math.max(0, Math.ceil(names.length / per) - 1));
    return Plotly.react(div, traces(charts[number], theme), layout(charts[number], theme, narrow && !width, width, space), {
      responsive: !width, displaylogo: false, displayModeBar: narrow ? false : "hover",
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
      toImageButtonOptions: { filename: charts[number].name, format: "svg" },
    });
  }

  let following = false;
  function follow(number, event) {
    const link = charts[number].link;
    if (!link || following) return;
    const range = event["xaxis.range"] ?? (event["xaxis.range[0]"] === undefined ? null : [event["xaxis.range[0]"], event["xaxis.range[1]"]]);
    const change = range ? { "xaxis.range": range } : event["xaxis.autorange"] ? { "xaxis.autorange": true } : null;
    if (!change) return;
    following = true;
    Promise.all(charts.map((other, i) => (i !== number && other.link === link && drawn.has(i) ? Plotly.relayout(place(i), change) : null)))
      .finally(() => { following = false; });
  }

  function table(chart) {
    const rows = ["trace,x,y,spread"];
    for (const t of chart.traces) t.y.forEach((y, i) => rows.push([JSON.stringify(t.name), t.x[i], y, t.spread ? t.spread[i] : ""].join(",")));
    return rows.join("\n") + "\n";
  }

  function offer(number) {
    const caption = place(number).parentElement.querySelector("figcaption");
    const button = (label, act) => {
      const b = document.createElement("button");
      b.type = "button"; b.textContent = label; b.addEventListener("click", act); caption.append(" ", b);
    };
    for (const format of ["svg", "png"])
      button(format.toUpperCase(), () => Plotly.downloadImage(place(number), { format, width: 1100, height: 620, scale: format === "png" ? 2 : 1, filename: charts[number].name }));
    button("CSV", () => {
      const a = document.createElement("a");
      a.href = URL.createObjectURL(new Blob([table(charts[number])], { type: "text/csv" }));
      a.download = `${charts[number].name}.csv`;
      a.click();
      URL.revokeObjectURL(a.href);
    });
  }

  // The largest value of every curve of the first panel within the shown frequencies.
  function peaks(number) {
    const chart = charts[number], out = place(number).parentElement.querySelector(".peaks");
    if (!chart.peaks) return;
    const range = place(number).layout.xaxis.range.map((v) => (chart.x_log ? 10 ** v : v));
    const said = [], unit = chart.panels[0].label.split("\n")[1] || "";
    for (const t of chart.traces) {
      if (t.panel !== 0) continue;
      let top = -1;
      t.x.forEach((x, i) => { if (x >= range[0] && x <= range[1] && !(t.y[i] <= t.y[top])) top = Number.isFinite(t.y[i]) ? i : top; });
      if (top >= 0) said.push(`${t.name}: ${Number(t.y[top].toPrecision(3))} ${unit} at ${Number(t.x[top].toPrecision(4))} ${chart.x_label.split(", ").at(-1)}`);
    }
    out.textContent = said.length ? `Largest in view: ${said.join("; ")}.` : "";
  }

  // A shape swings about its rest position: each point by its complex amplitude.
  const shapes = [...document.querySelectorAll("svg.shape")].map((svg) => ({
    svg, line: svg.querySelector(".swing"), dots: [...svg.querySelectorAll("circle")].map((dot) =>
      ({ dot, x: Number(dot.getAttribute("cx")), re: Number(dot.dataset.re), im: Number(dot.dataset.im) })),
  }));
  function swing(phase) {
    for (const { svg, line, dots } of shapes) {
      if (!svg.getClientRects().length) continue;
      const places = dots.map(({ dot, x, re, im }) => {
        const y = 60 - 42 * (re * Math.cos(phase) - im * Math.sin(phase));
        dot.setAttribute("cy", y.toFixed(1));
        return `${x},${y.toFixed(1)}`;
      });
      line.setAttribute("points", places.join(" "));
    }
  }
  if (shapes.length) {
    swing(0);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) {
      const tick = (now) => { swing(now / 350); requestAnimationFrame(tick); };
      requestAnimationFrame(tick);
    }
  }

  // What a hidden page holds is drawn when the page is first opened.
  const drawn = new Set();
  const all = (theme, width) => Promise.all([...drawn].map((i) => draw(i, theme, width)));
  const PAPER = 690;  // pixels between the margins of an A4 or letter page
  function show() {
    const fresh = charts.map((_, i) => i).filter((i) => !drawn.has(i) && place(i).offsetParent !== null && !place(i).closest("details:not([open])"));
    return Promise.all(fresh.map((i) => {
      unpack(charts[i]);
      drawn.add(i);
      return draw(i).then(() => { place(i).on("plotly_relayout", (event) => { follow(i, event); peaks(i); }); offer(i); peaks(i); });
    })).then(() => { root.dataset.drawn = String(drawn.size); });
  }
  // A link to a folded section opens it.
  function unfold() {
    const target = location.hash.length > 1 && document.getElementById(location.hash.slice(1));
    const folded = target && target.querySelector("details");
    if (folded) folded.open = true;
  }
  const folds = [...document.querySelectorAll("details")];
  for (const one of folds) one.addEventListener("toggle", show);
  unfold();
  show();
  addEventListener("load", show);  // by then a link from outside has opened its page
  addEventListener("hashchange", () => { unfold(); show(); });
  document.getElementById("theme").addEventListener("click", () => { root.dataset.theme = dark() ? "light" : "dark"; all(); });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => all());
  let before, opened;
  addEventListener("beforeprint", () => { opened = folds.filter((one) => !one.open); for (const one of opened) one.open = true; show(); before = root.dataset.theme; root.dataset.theme = "light"; all("light", PAPER); });
  addEventListener("afterprint", () => { for (const one of opened) one.open = false; if (before) root.dataset.theme = before; else delete root.dataset.theme; all(); });
})();
