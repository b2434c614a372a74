import { $, address, ask, attempting, bytes, clock, el, Fault, ready, say, shortly, tell } from "./page.js";

let session = "", held = [];

const draw = attempting(async () => {
  const wanted = { name: $("board").value, paper: $("paper").value };
  const answer = await fetch(address("api/calibrate/board", wanted));
  if (!answer.ok) throw new Fault((await answer.json()).error);
  $("board-image").src = address("api/calibrate/board", wanted);
  $("board-image").hidden = $("pdf").hidden = false;
  $("pdf").href = address("api/calibrate/board", { ...wanted, form: "pdf" });
  say("");
});

function listed(views) {
  held = views;
  $("views").replaceChildren(...views.map((view) => el("li", {}, `${view.name}, ${bytes(view.bytes)}`,
    el("button", { type: "button", "aria-label": `Forget ${view.name}`, onclick: attempting(async () => { listed((await tell("api/calibrate/forget", { session, name: view.name })).views); }) }, "×"))));
  clips();
}

const take = attempting(async (files) => {
  for (const [number, file] of [...files].entries()) {
    say(`Taking ${number + 1} of ${files.length}: ${file.name}`);
    const found = await ask(`api/upload/${session}/${encodeURIComponent(file.name)}`, { method: "PUT", body: file, headers: { "Content-Type": "application/octet-stream" } });
    listed(found.views);
  }
  say("");
});

async function followed(errand, place) {
  while (errand.state === "working") {
    $(place).classList.remove("error");
    $(place).textContent = `Measuring, since ${clock(errand.seconds)} ...`;
    errand = await ask(`api/errand/${errand.id}?version=${errand.version}`);
  }
  $(place).classList.toggle("error", errand.state !== "done");
  $(place).textContent = errand.state === "done" ? errand.words.filter((line) => !line.startsWith("written:") && !line.startsWith("not used")).join(" · ")
    : errand.words.filter((line) => !line.startsWith("not used")).slice(-1)[0] || "This came to nothing; drop in other views.";
  const now = await tell("api/calibrate/session", { session });
  $("save").disabled = !now.profile;
  return errand.state === "done" ? now : { ...now, refusals: errand.words.filter((line) => line.startsWith("not used")) };
}

const facts = (place, lines) => $(place).replaceChildren(...lines.flatMap(([name, value]) => [el("dt", {}, name), el("dd", {}, value)]));
const spread = (value) => (value.std ? `${shortly(value.value, 6)} ± ${shortly(value.std, 2)}` : shortly(value.value, 6));

function showLens(now) {
  const found = now.found.lens;
  $("residuals").hidden = !found;
  if (!found) { $("refused").replaceChildren(...(now.refusals || []).map((line) => el("li", {}, line))); return; }
  const lens = found.profile.intrinsics;
  facts("lens-facts", [["lens", found.model], ["focal length", `${spread(lens.fx)} px`], ["principal point", `${spread(lens.cx)}, ${spread(lens.cy)} px`],
    ["left over", `${found.rms_px.toFixed(3)} px`], ["coverage", `${Math.round(100 * found.coverage)} % of the picture, ${Math.round(100 * found.reach)} % of the way to its corners`],
    ["views", `${found.views.length} used, ${found.refused.length} refused`]]);
  $("residuals").src = address(`api/calibrate/figure/${session}/residuals`, { at: Date.now() });
  $("refused").replaceChildren(...found.refused.map((view) => el("li", {}, `not used: ${view.name}: ${view.why}`)));
}

function showReadout(now) {
  const found = now.found.readout;
  if (!found) return;
  facts("readout-facts", [["readout", `${shortly(1e3 * found.readout_s)} ms${found.std_s ? ` ± ${shortly(1e3 * found.std_s, 2)} ms` : ""}`], ["direction", found.direction || "not seen"], ["by", found.how]]);
}

const lens = attempting(async () => {
  showLens(await followed(await tell("api/calibrate/lens", { session, board: $("board").value, model: $("model").value, name: $("camera").value }), "lens-words"));
});

const readout = attempting(async () => {
  const chosen = $("flicker-clip").value;
  if (!chosen) throw new Fault("There is no clip to measure; drop one in above, or open a folder that holds one.");
  const [kind, clip] = [chosen.slice(0, 1), chosen.slice(1)];
  showReadout(await followed(await tell("api/calibrate/readout", { session, clip, dropped: kind === "d", flicker: $("hertz").value, name: $("camera").value }), "readout-words"));
});

let inFolder = [];
function clips() {
  const before = $("flicker-clip").value;
  const dropped = held.map((view) => el("option", { value: `d${view.name}` }, `dropped in: ${view.name}`));
  $("flicker-clip").replaceChildren(...dropped, ...inFolder.map((name) => el("option", { value: `f${name.at}` }, name.name)));
  if (before) $("flicker-clip").value = before;
}

const save = attempting(async () => {
  try {
    const made = await tell("api/calibrate/save", { session, name: $("profile-name").value, at: $("folder").value, overwrite: $("overwrite").checked });
    $("saved").classList.remove("error");
    $("saved").textContent = `Saved as ${made.name}; write it into a clip's field "profile", or type --camera ${made.name}.`;
    $("profile").src = address(`api/calibrate/figure/${session}/profile`, { at: Date.now() });
    $("profile").hidden = false;
  } catch (error) {
    $("saved").classList.add("error");
    $("saved").textContent = error.message;
  }
});

$("draw").addEventListener("click", draw);
$("lens").addEventListener("click", lens);
$("readout").addEventListener("click", readout);
$("save").addEventListener("click", save);
$("files").addEventListener("change", () => take($("files").files));
$("drop").addEventListener("dragover", (event) => { event.preventDefault(); $("drop").classList.add("over"); });
$("drop").addEventListener("dragleave", () => $("drop").classList.remove("over"));
$("drop").addEventListener("drop", (event) => { event.preventDefault(); $("drop").classList.remove("over"); take(event.dataTransfer.files); });

const open = attempting(async () => {
  let now;
  try {
    now = await tell("api/calibrate/session", { session: sessionStorage.getItem("rsvideo session") || "" });
  } catch {
    now = await tell("api/calibrate/session", { session: "" });
  }
  session = now.session;
  sessionStorage.setItem("rsvideo session", session);
  const folder = await ask("api/folder");
  inFolder = folder.names.filter((name) => ["clip", "photograph", "sequence"].includes(name.kind));
  $("folder").replaceChildren(...folder.folders.map((each) => el("option", { value: each.at }, each.name)));
  listed(now.views);
  $("save").disabled = !now.profile;
  showLens(now);
  showReadout(now);
  ready();
});
open();
