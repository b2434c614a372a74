import { $, address, ask, attempting, bytes, clock, el, Fault, here, ready, say, shortly, tell } from "./page.js";
import { Fields } from "./fields.js";
import { drawn, words } from "./strip.js";

const at = here.get("at") || "";
const kept = `rsvideo ${at}`;
const ended = ["done", "failed", "replaced"];
let fields, facts, frames = 1, shown = null, keptA = null, turn = 0, wanted = false, strip = null, mark = () => {};

const frame = () => Math.min(Math.max(0, Math.round(Number($("frame").value) || 0)), frames - 1);
const last = () => Math.min(Math.max(frame(), Math.round(Number($("last").value) || 0)), frames - 1);
const original = () => address("api/frame", { at, index: frame(), side: 1920 });

// what can stand on either side: the frame as it came, the preview, and one that was kept
function sides() {
  const out = { original: { title: "original", picture: beforeOf(shown) || beforeOf(keptA) || original() } };
  if (keptA && pictureOf(keptA, "after")) out.a = { title: `A: ${keptA.title}`, picture: pictureOf(keptA, "after") };
  if (shown && pictureOf(shown, "after")) out.now = { title: keptA ? `B: ${shown.title}` : "restored", picture: pictureOf(shown, "after") };
  return out;
}
const sizeOf = (preview) => (preview && (preview.sizes.full ? "full" : preview.sizes.half ? "half" : null));
function pictureOf(preview, what) {
  const size = sizeOf(preview), name = size && `${size}-${frame()}-${what}`;
  return size && preview.pictures.includes(name) ? `api/preview/${preview.id}/${name}` : null;
}
const beforeOf = (preview) => pictureOf(preview, "before");

function choose(select, options, value) {
  const now = [...select.options].map((option) => `${option.value} ${option.text}`).join();
  const next = Object.entries(options).map(([key, side]) => `${key} ${side.title}`).join();
  if (now !== next) select.replaceChildren(...Object.entries(options).map(([key, side]) => el("option", { value: key }, side.title)));
  select.value = value in options ? value : "original";
}

function pictures() {
  const options = sides();
  const before = $("left").value || "original", after = $("right").value || "now";
  choose($("left"), options, before in options ? before : keptA ? "a" : "original");
  choose($("right"), options, after !== "original" && after in options ? after : "now" in options ? "now" : "original");
  for (const [image, tag, select] of [["left-image", "left-tag", "left"], ["right-image", "right-tag", "right"]]) {
    const side = options[$(select).value];
    if ($(image).getAttribute("src") !== side.picture) $(image).src = side.picture;
    $(image).alt = side.title;
    $(tag).textContent = side.title;
  }
  const motion = pictureOf(shown, "motion");
  if (motion) $("motion-image").src = motion;
  $("motion-layer").hidden = !($("show-motion").checked && motion);
  for (const [figure, image, what] of [["path-figure", "path", "path"], ["heat-figure", "heat", "residual"]]) {
    const picture = pictureOf(shown, what);
    $(figure).hidden = !picture;
    if (picture) $(image).src = picture;
  }
  divide();
}

function divide() {
  const part = Number($("divider").value);
  $("over").style.clipPath = `inset(0 ${100 - part}% 0 0)`;
  $("handle").style.left = `${part}%`;
  $("divider").setAttribute("aria-valuetext", `${Math.round(part)} % ${$("left-tag").textContent}, the rest ${$("right-tag").textContent}`);
  $("left-tag").style.opacity = part > 12 ? 1 : 0;
  $("right-tag").style.opacity = part < 88 ? 1 : 0;
}

function explain() {
  const size = sizeOf(shown), told = size && shown.sizes[size], one = told && told.frames.find((each) => each.index === frame());
  $("facts").replaceChildren();
  document.documentElement.dataset.preview = shown ? `${shown.state} ${size || ""}`.trim() : "";
  if (!one) return;
  const lines = [
    ["verdict", one.verdict], ["size", `${told.cols} × ${told.rows} px${size === "half" ? ", half size, a draft: small blur and the prior show at full size only" : ""}`],
    ["exposure", `${shortly(1e3 * told.exposure_s)} ms: ${told.exposure_source === "explicit" ? "typed in" : told.exposure_source}`],
    ["readout", `${shortly(1e3 * told.readout_s)} ms: ${told.readout_source === "explicit" ? "typed in" : told.readout_source}`],
  ];
  if (one.blur_px !== undefined) lines.push(["blur", `${one.blur_px.toFixed(1)} px in the frame's middle`]);
  lines.push(["took", `${told.seconds.toFixed(1)} s, restored by itself; in a job its neighbours help`]);
  for (const note of told.notes) lines.push(["note", note]);
  $("facts").replaceChildren(...lines.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
  if (one.magnified) $("path-words").textContent = `The path over the frame's time; in the picture it is drawn ${one.magnified} times as large, from its dot on.`;
  if (one.unexplained !== undefined) $("heat-words").textContent = `What the motion does not explain: ${(100 * one.unexplained).toFixed(2)} % of white on average; the hottest is 6 % and more.`;
}

function progress(preview) {
  const busy = !ended.includes(preview.state);
  $("progress").hidden = $("stop").hidden = !busy;
  $("progress").value = preview.fraction;
  $("stage-words").classList.toggle("error", preview.state === "failed");
  $("stage-words").textContent = preview.state === "failed" ? preview.error : busy ? `${preview.stage || "waiting"} ...` : "";
}

async function follow(preview, show) {
  const mine = ++turn;
  for (;;) {
    if (mine !== turn) return null;
    progress(preview);
    show(preview);
    if (ended.includes(preview.state)) return preview;
    preview = await ask(`api/preview/${preview.id}?version=${preview.version}`);
  }
}

const title = () => {
  const stated = Object.entries(fields.stated()).flatMap(([, given]) => Object.entries(given).map(([name, value]) => `${name.replace(/_/g, " ")} ${value}`));
  return stated.slice(0, 3).join(", ") || "as stated";
};

const preview = attempting(async () => {
  wanted = true;
  const named = title(), mine = turn;
  let begun;
  try {
    begun = await tell("api/preview", { at, settings: fields.stated(), first: frame(), last: last() });
  } catch (error) {
    if (error instanceof Fault) fields.blame(error.faults);
    $("stage-words").textContent = error.message;
    $("stage-words").classList.add("error");
    if (!(error instanceof Fault)) throw error;
    return;
  }
  if (mine !== turn && !begun) return;
  fields.blame({});
  await follow(begun, (now) => {
    if (sizeOf(now)) { shown = { ...now, title: named }; $("right").value = "now"; pictures(); explain(); }
    else document.documentElement.dataset.preview = now.state;
  });
});

const look = attempting(async () => {
  try {
    const found = await tell("api/facts", { at, settings: fields ? fields.stated() : JSON.parse(localStorage.getItem(kept) || "{}") });
    if (fields) fields.blame({});
    return found;
  } catch (error) {
    if (fields && error instanceof Fault && Object.keys(error.faults).length) { fields.blame(error.faults); return null; }
    throw error;
  }
});

let later = 0;
async function changed() {
  localStorage.setItem(kept, JSON.stringify(fields.stated()));
  const found = await look();
  if (!found) return;
  facts = found.facts;
  fields.explain(facts);
  clearTimeout(later);
  if (wanted) later = setTimeout(preview, 300);
}

function moved(index, again = true) {
  const span = last() - frame();
  $("frame").value = Math.min(Math.max(0, index), frames - 1);
  $("last").value = Math.min(frame() + span, frames - 1);
  $("picker").value = frame();
  mark(frame());
  if (strip) $("strip-words").textContent = words(strip, frame());
  for (const button of $("film").children) button.setAttribute("aria-pressed", Number(button.dataset.index) === frame());
  pictures();
  explain();
  clearTimeout(later);
  if (again && wanted && !beforeOf(shown)) later = setTimeout(preview, 300);
}

function film() {
  const most = Math.min(frames, 24), chosen = [...new Set([...Array(most).keys()].map((k) => Math.round(k * (frames - 1) / Math.max(1, most - 1))))];
  $("film").replaceChildren(...chosen.map((index) => el("button", { type: "button", "data-index": index, "aria-label": `frame ${index}`, "aria-pressed": index === frame(), onclick: () => moved(index) },
    el("img", { alt: "", loading: "lazy", src: address("api/frame", { at, index, side: 160 }) }), el("span", {}, String(index)))));
}

const strips = attempting(async (which = 0) => {
  const found = await ask(address("api/strip", { at, which }));
  $("which").replaceChildren(...found.sidecars.map((each, k) => el("option", { value: k }, each.what)));
  $("which").value = String(which);
  $("which").parentElement.hidden = !found.sidecars.length;
  strip = found.strip;
  if (strip) { mark = drawn($("track-box"), $("legend"), strip, frames); moved(frame(), false); }
  else $("strip-words").textContent = "Nothing tells yet how its frames are; finding the motion does, and so does a job's result.";
});

const track = attempting(async () => {
  let errand = await tell("api/track", { at, settings: fields.stated() });
  $("track-stop").hidden = false;
  $("track-stop").onclick = attempting(() => tell(`api/errand/${errand.id}/cancel`, {}));
  while (errand.state === "working") {
    $("strip-words").textContent = `The motion of all frames is being found, since ${clock(errand.seconds)}; you can go on meanwhile.`;
    errand = await ask(`api/errand/${errand.id}?version=${errand.version}`);
  }
  $("track-stop").hidden = true;
  if (errand.state === "done") await strips(0);
  else throw new Fault(errand.state === "cancelled" ? "Finding the motion was ended." : errand.words.slice(-1)[0] || "the motion was not found; type in the exposure and the readout");
});

const measure = attempting(async () => {
  const begun = await tell("api/measure", { at, settings: fields.stated() });
  const done = await follow(begun, () => {});
  if (done && done.state === "done") {
    facts = { ...facts, ...done.sizes.full };
    fields.explain(facts);
    const notes = done.sizes.full.notes.filter((note) => note.startsWith("not measured"));
    say(notes.join("; ") || "Measured; the settings say what was found.");
  }
});

const save = attempting(async () => {
  $("saved").textContent = "";
  try {
    const made = await tell("api/save", { at, settings: fields.stated(), name: $("job-name").value, sources: fields.sources(), overwrite: $("job-overwrite").checked });
    $("saved").classList.remove("error");
    $("saved").replaceChildren(`Saved as ${made.name}. `, el("a", { href: address("jobs", { at: made.at }), id: "to-job" }, "Start it"), ", or type ", el("code", {}, `rsvideo run ${made.name}`));
    $("job-text").textContent = made.text;
    $("job-text").hidden = false;
  } catch (error) {
    fields.blame(error.faults || {});
    $("saved").classList.add("error");
    $("saved").textContent = error.message;
  }
});

function describe() {
  const words = [`${facts.cols} × ${facts.rows} px`];
  if (facts.is_clip) words.push(`${facts.frames} frames`, `${facts.duration_s.toFixed(2)} s at ${shortly(facts.frame_rate, 5)} a second${facts.variable_frame_rate ? ", varying" : ""}`, facts.codec);
  if (facts.rotation_deg) words.push("shown upright here");
  const camera = [facts.make, facts.model].map((fact) => fact && fact.value).filter(Boolean).join(" ");
  if (camera) words.push(`by ${camera}`);
  $("meta").textContent = words.join(", ");
  if (facts.notes.length) say(facts.notes.join(" · "));
}

const open = attempting(async () => {
  const found = await look();
  if (!found) return;
  $("title").textContent = found.name;
  document.title = `${found.name} · rsvideo`;
  facts = found.facts;
  frames = facts.frames;
  for (const field of found.fields) field.name_ = field.key.split(".")[1];
  fields = new Fields($("settings"), found.fields, JSON.parse(localStorage.getItem(kept) || "{}"), changed);
  fields.explain(facts);
  describe();
  $("job-name").value = found.name.replace(/\.[^.]*$/, "");
  for (const id of ["frame", "last", "picker"]) $(id).max = frames - 1;
  const first = Math.min(Number(here.get("frame")) || Math.floor(frames / 2), frames - 1);
  $("frame").value = $("last").value = first;
  $("strip-section").hidden = !facts.is_clip;
  $("measure").hidden = !facts.is_clip;
  for (const id of ["frame", "last"]) $(id).parentElement.hidden = !facts.is_clip;
  moved(first, false);
  ready();
  if (facts.is_clip) { await strips(0); film(); }
});

$("divider").addEventListener("input", divide);
for (const id of ["left", "right", "show-motion"]) $(id).addEventListener("change", pictures);
$("keep").addEventListener("click", () => {
  if (!shown) { say("There is no preview to keep; make one first."); return; }
  keptA = shown;
  choose($("left"), sides(), "a");
  pictures();
  say("Kept as A: change a setting, and compare it with what comes.");
});
$("preview").addEventListener("click", preview);
$("stop").addEventListener("click", () => { turn++; wanted = false; $("progress").hidden = $("stop").hidden = true; $("stage-words").textContent = ""; });
$("frame").addEventListener("change", () => moved(Number($("frame").value)));
$("last").addEventListener("change", () => { $("last").value = last(); });
$("picker").addEventListener("input", () => moved(Number($("picker").value)));
$("track-box").addEventListener("click", (event) => {
  const box = $("track-box").getBoundingClientRect();
  moved(Math.floor((event.clientX - box.left) / box.width * frames));
});
$("which").addEventListener("change", () => strips(Number($("which").value)));
$("track").addEventListener("click", track);
$("measure").addEventListener("click", measure);
$("save").addEventListener("click", save);
open();
