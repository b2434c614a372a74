// The settings of a clip: one field for each option, with its unit, its bounds and who states it otherwise.
import { el, shortly } from "./page.js";

const TITLES = { camera: "Camera", motion: "Motion", deblur: "Restoration", input: "What is read", encoding: "What is written" };
const FACTS = {
  "camera.exposure": ["exposure_s", (v) => `${shortly(1e3 * v)} ms`], "camera.readout": ["readout_s", (v) => `${shortly(1e3 * v)} ms`],
  "camera.row_time": ["row_time_s", (v) => `${shortly(1e6 * v)} us`], "camera.direction": ["direction", String],
  "camera.focal_px": ["focal_px", (v) => `${shortly(v)} px`], "camera.transfer": ["transfer", String],
};

export class Fields {
  constructor(form, fields, stated, changed) {
    this.form = form;
    this.fields = fields;
    this.places = new Map();
    const sections = new Map();
    for (const field of fields) {
      if (!sections.has(field.section)) {
        const camera = field.section === "camera";
        const box = el(camera ? "div" : "details", {}, camera ? el("h3", {}, TITLES.camera) : el("summary", {}, TITLES[field.section]));
        sections.set(field.section, box);
      }
      sections.get(field.section).append(this.made(field, (stated[field.section] || {})[field.name_]));
    }
    const order = ["camera", "deblur", "motion", "input", "encoding"].filter((name) => sections.has(name));
    form.replaceChildren(...order.map((name) => sections.get(name)));
    form.addEventListener("submit", (event) => event.preventDefault());
    form.addEventListener("change", changed);
  }

  made(field, value) {
    const id = `field-${field.key.replace(".", "-")}`, given = value ?? "";
    let input;
    if (field.switch) input = el("input", { type: "checkbox", id, checked: given === true });
    else if (field.choices) {
      const left = field.default || field.unless || "as stated";
      const choices = [el("option", { value: "" }, `not set: ${left}`), ...field.choices.map((choice) => el("option", { value: choice, selected: choice === given }, choice))];
      input = el("select", { id }, ...choices);
    } else input = el("input", { type: "text", id, value: String(given), placeholder: field.default || "", spellcheck: "false", maxlength: 400 });
    const words = [field.help, field.bounds && `Bounds: ${field.bounds}.`, !field.choices && field.unless && `Left out: ${field.unless}.`];
    const help = el("p", { id: `${id}-help` }, words.filter(Boolean).join(" "));
    const source = el("p", { class: "source", id: `${id}-source` }), fault = el("p", { class: "error", id: `${id}-fault` });
    input.setAttribute("aria-describedby", `${id}-help ${id}-source ${id}-fault`);
    this.places.set(field.key, { field, input, source, fault });
    return el("div", { class: "field" }, el("label", { for: id }, field.name, el("span", { class: "unit" }, field.unit)), input, source, fault, help);
  }

  stated() {
    const out = {};
    for (const { field, input } of this.places.values()) {
      const value = field.switch ? input.checked : input.value.trim();
      if (value !== "" && value !== false) (out[field.section] ||= {})[field.name_] = value;
    }
    return out;
  }

  // what holds where nothing is typed in, and who says it
  explain(facts) {
    for (const [key, { field, input, source }] of this.places) {
      const [name, written] = FACTS[key] || [];
      const fact = name && facts[name];
      const typed = field.switch ? input.checked : input.value.trim() !== "";
      if (fact) {
        const within = fact.within && fact.within[0] !== fact.within[1] ? `, between ${written(fact.within[0])} and ${written(fact.within[1])}` : "";
        const by = fact.source === "explicit" ? "typed in" : fact.source;
        source.textContent = `${written(fact.value)}${within}: ${by}`;
      } else source.textContent = typed ? "typed in" : name && key !== "camera.transfer" ? "nobody states it" : "";
    }
  }

  sources() {
    const out = {};
    for (const [key, { source, input, field }] of this.places)
      if (source.textContent && source.textContent !== "nobody states it" && !(field.switch ? input.checked : input.value.trim())) out[key] = source.textContent;
    return out;
  }

  blame(faults) {
    for (const [key, { input, fault }] of this.places) {
      fault.textContent = faults[key] || "";
      input.setAttribute("aria-invalid", key in faults);
      if (key in faults) { const box = input.closest("details"); if (box) box.open = true; }
    }
  }
}
