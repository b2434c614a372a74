import { $, address, ask, attempting, bytes, clock, el, here, ready, say, tell } from "./page.js";

const UNDER_WAY = ["running", "preparing", "starting", "pausing", "paused"];
const WORDS = {
  running: "running", preparing: "opening its clips", starting: "starting", pausing: "pausing", paused: "paused", failed: "failed",
  interrupted: "interrupted: start goes on", done: "done", ready: "not started",
};
const wanted = here.get("at");
const places = new Map();

const steer = (what, more = () => ({})) => (job) => attempting(async () => {
  say("");
  drawn(await tell(`api/jobs/${what}`, { at: job.at, ...more() }));
});

function made(job) {
  const place = { job, seen: "" };
  place.title = el("span", {});
  place.state = el("span", { class: "state" });
  place.bar = el("progress", { max: 1, "aria-label": `Progress of ${job.name}` });
  place.numbers = el("div", { class: "numbers" });
  place.words = el("p", { class: "error" });
  place.workers = el("input", { type: "number", min: 1, max: 64, value: 1, "aria-label": "Workers" });
  place.overwrite = el("input", { type: "checkbox" });
  const button = (name, words, what, more) => (place[name] = el("button", { type: "button", onclick: () => steer(what, more)(place.job)() }, words));
  place.starting = el("div", { class: "row" },
    button("start", "Start", "start", () => ({ workers: Number(place.workers.value) || 1, overwrite: place.overwrite.checked })),
    el("label", {}, "workers", place.workers), el("label", {}, "replace results of others", place.overwrite));
  place.steering = el("div", { class: "row" }, button("pause", "Pause", "pause"), button("resume", "Resume", "resume"), button("cancel", "Cancel", "cancel"));
  place.rows = el("tbody", {});
  place.clips = el("div", { class: "clips" }, el("table", {}, el("thead", {}, el("tr", {}, ...["clip", "state", "chunks", "result"].map((name) => el("th", { scope: "col" }, name)))), place.rows));
  place.article = el("article", { class: "job", "data-name": job.name }, el("h2", {}, place.title, place.state), place.bar, place.numbers, place.words, place.starting, place.steering, place.clips);
  place.start.classList.add("main");
  return place;
}

const STATES = { waiting: "waiting", working: "under way", finished: "finished", failed: "failed" };

function row(clip) {
  const source = clip.source_at ? el("a", { href: address("clip", { at: clip.source_at }) }, clip.source_name) : clip.source_name;
  const result = clip.output_at && clip.state === "finished" ? el("a", { class: "result", href: address("clip", { at: clip.output_at }) }, clip.output_name) : clip.output_name;
  const part = clip.state === "working" ? `${Math.round(100 * clip.fraction)} %${clip.words ? `, ${clip.words}` : ""}` : clip.words;
  const state = el("td", { class: clip.state === "failed" ? "error" : "" }, part ? `${STATES[clip.state]}: ${part}` : STATES[clip.state]);
  return el("tr", {}, el("td", {}, source), state, el("td", {}, clip.chunks ? `${clip.chunks_done} of ${clip.chunks}` : ""), el("td", {}, result));
}

function update(place, job) {
  place.job = job;
  const busy = UNDER_WAY.includes(job.state);
  place.title.textContent = job.name;
  place.state.textContent = WORDS[job.state] || job.state;
  place.state.className = `state ${job.state}`;
  place.article.dataset.state = job.state;
  place.bar.hidden = !busy;
  place.bar.value = job.frames ? job.done / job.frames : 0;
  const numbers = [];
  const add = (name, value) => value !== "" && value !== null && value !== undefined && numbers.push(el("span", {}, `${name} `, el("b", {}, String(value))));
  if (job.frames) add("frames", `${Math.floor(job.done)} of ${job.frames}`);
  if (job.clips.some((clip) => clip.chunks)) add("chunks", `${job.clips.reduce((n, clip) => n + clip.chunks_done, 0)} of ${job.clips.reduce((n, clip) => n + clip.chunks, 0)}`);
  if (busy && job.state !== "paused") add("left", clock(job.seconds_left));
  add("memory", bytes(job.memory));
  if (busy) add("workers", job.workers);
  add("scheduler", job.scheduler);
  add("machine", job.host);
  const failed = job.clips.filter((clip) => clip.state === "failed").length;
  if (failed) add("failed", `${failed} of ${job.clips.length + (job.more || 0)}`);
  place.numbers.replaceChildren(...numbers);
  place.words.textContent = job.fault || job.words;
  place.words.hidden = !place.words.textContent;
  place.starting.hidden = busy || !job.at || Boolean(job.fault);
  place.start.textContent = job.state === "interrupted" || job.state === "failed" ? "Go on" : job.state === "done" ? "Start again" : "Start";
  place.steering.hidden = !busy || !job.at;
  place.pause.hidden = job.state === "paused" || job.state === "pausing";
  place.resume.hidden = !place.pause.hidden;
  const seen = JSON.stringify(job.clips);
  if (seen !== place.seen) { place.rows.replaceChildren(...job.clips.map(row)); place.seen = seen; }
  place.clips.hidden = !job.clips.length;
}

function drawn({ jobs }) {
  const keys = new Set();
  jobs.forEach((job, k) => {
    const key = job.at || `? ${job.name}`;
    keys.add(key);
    if (!places.has(key)) {
      const place = made(job);
      places.set(key, place);
      $("jobs").append(place.article);
      if (job.at === wanted) { place.article.id = "wanted"; requestAnimationFrame(() => place.article.scrollIntoView({ block: "start" })); }
    }
    update(places.get(key), job);
  });
  for (const [key, place] of places) if (!keys.has(key)) { place.article.remove(); places.delete(key); }
  const busy = jobs.filter((job) => UNDER_WAY.includes(job.state)).length;
  $("count").textContent = jobs.length ? `${jobs.length} ${jobs.length === 1 ? "job" : "jobs"}, ${busy} under way, whoever started them` : "There is no job in the folders that were opened; save one on a clip's page.";
  return busy;
}

async function watch() {
  let busy = 0;
  try {
    if (!document.hidden) busy = drawn(await ask("api/jobs"));
    if ($("say").classList.contains("error") && $("say").textContent.startsWith("the server")) say("");
  } catch (error) {
    say(error.message, true);
  }
  setTimeout(watch, busy ? 1000 : 5000);
}

const reports = attempting(async () => {
  const found = await ask("api/reports");
  const listed = found.reports.map((report) => el("li", {}, el("a", { href: report.address }, report.name)));
  $("reports").replaceChildren(...(listed.length ? listed : [el("li", {}, "none")]));
});

document.addEventListener("visibilitychange", () => { if (!document.hidden) ask("api/jobs").then(drawn).catch(() => {}); });
await watch();
await reports();
ready();
