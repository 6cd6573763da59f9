"use strict";
// Draws the points of a mode shape and moves them: each by the real part of its component times exp(i phase).
const { geometry, modes } = JSON.parse(document.getElementById("data").textContent);
const svg = document.getElementById("shape");
const choice = document.getElementById("mode");
const size = document.getElementById("size");
const button = document.getElementById("run");
const make = (kind, attributes, text) => {
  const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  if (text) element.textContent = text;
  svg.append(element);
  return element;
};
const joined = (points) => points.map((p) => p.join(",")).join(" ");
const rest = geometry.points.map((p) => [p.x, p.y]);
if (geometry.joined) make("polyline", { class: "rest", points: joined(rest) });
const line = geometry.joined ? make("polyline", { class: "moved" }) : null;
const drawn = geometry.points.map((p) =>
  p.width
    ? make("rect", { class: p.channel ? "box" : "still", width: p.width, height: p.height, rx: 4 })
    : make("circle", { class: "dot", r: 4 }));
const labels = geometry.points.map((p) => make("text", {}, p.label));
modes.forEach((mode, k) => {
  const option = document.createElement("option");
  option.value = String(k);
  option.textContent = mode.label;
  choice.append(option);
});
let phase = 0;
let running = true;
const show = () => {
  const shape = modes[Number(choice.value)].shape;
  const scale = Number(size.value);
  const at = geometry.points.map((p) => {
    const [real, imag] = shape[p.channel] || [0, 0];
    const part = scale * (real * Math.cos(phase) - imag * Math.sin(phase));
    return [p.x + part * p.move_x, p.y + part * p.move_y];
  });
  if (line) line.setAttribute("points", joined(at));
  drawn.forEach((element, k) => {
    const [x, y] = at[k];
    const box = geometry.points[k].width > 0;
    element.setAttribute(box ? "x" : "cx", x);
    element.setAttribute(box ? "y" : "cy", y);
    labels[k].setAttribute("x", x + (box ? 10 : 6));
    labels[k].setAttribute("y", y + (box ? 18 : -8));
  });
};
const step = () => {
  if (running) phase += 0.08;
  show();
  requestAnimationFrame(step);
};
button.addEventListener("click", () => {
  running = !running;
  button.textContent = running ? "pause" : "animate";
});
if (modes.length) step();
