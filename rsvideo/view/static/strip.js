// The frames of a clip over time: blur as bars in the colour of the verdict, and how far the blur bears the path out as a line.
import { el } from "./page.js";

const SVG = "http://www.w3.org/2000/svg";
const svg = (name, attributes) => {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  return made;
};
export const kind = (verdict) =>
  /^(restored|deblurred)/.test(verdict) ? "restored" : verdict.startsWith("straightened") ? "straight"
    : verdict.includes("sharp already") || verdict.includes("no readout") || verdict.includes("no restoration") ? "left" : "wrong";
const NAMES = { restored: "restored", straight: "straightened only", left: "left as it was", wrong: "not explained, damaged or without texture" };

export function drawn(box, legend, strip, frames) {
  box.hidden = legend.hidden = false;
  const width = 1000, height = 120, most = Math.max(2, ...strip.blur);
  const across = (index) => (index + 0.5) / frames * width;
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", role: "img", "aria-label": "Blur, verdict and confidence of each frame" });
  const bars = {};
  const wide = Math.max(1, 0.8 * box.clientWidth / Math.max(1, frames));
  strip.frames.forEach((index, k) => {
    const x = across(index).toFixed(2), top = (height - 4 - (height - 14) * strip.blur[k] / most).toFixed(1);
    (bars[kind(strip.verdicts[strip.verdict[k]])] ||= []).push(`M${x},${height}V${top}`);
  });
  for (const [name, parts] of Object.entries(bars)) picture.append(svg("path", { class: `bar ${name}`, d: parts.join("") }));
  for (const path of picture.querySelectorAll(".bar")) path.style.strokeWidth = `${wide}px`;
  const sure = strip.confidence.map((value, k) => (value === null ? null : `${across(strip.frames[k]).toFixed(2)},${(8 + (height - 16) * (1 - value)).toFixed(1)}`)).filter(Boolean);
  if (sure.length > 1) picture.append(svg("path", { class: "sure", d: `M${sure.join("L")}` }));
  const here = svg("path", { class: "here", d: "" });
  picture.append(here);
  box.replaceChildren(picture);
  const told = Object.keys(bars).map((name) => el("li", {}, el("span", { class: `swatch ${name}` }), NAMES[name]));
  if (sure.length > 1) told.push(el("li", {}, el("span", { class: "swatch sure" }), "confidence, 0 to 1: how far the blur bears the motion out"));
  told.push(el("li", {}, `highest bar: ${most.toFixed(1)} px of blur`));
  legend.replaceChildren(...told);
  return (index) => here.setAttribute("d", `M${across(index)},0V${height}`);
}

export function words(strip, index) {
  const k = strip.frames.findIndex((each) => each >= index);
  if (k < 0) return "";
  const sure = strip.confidence[k] === null ? "" : `, confidence ${strip.confidence[k]}`;
  return `frame ${strip.frames[k]}, ${strip.times[k].toFixed(2)} s: ${strip.blur[k].toFixed(1)} px of blur${sure}; ${strip.verdicts[strip.verdict[k]]}`;
}
