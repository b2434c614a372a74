import { $, address, ask, attempting, bytes, el, here, ready, say } from "./page.js";

const KINDS = { folder: "folder", job: "job", report: "report", sequence: "folder of pictures", clip: "clip", photograph: "photograph" };

function link(name) {
  if (name.kind === "folder") return address("./", { at: name.at });
  if (name.kind === "report") return `report/${name.at.split("/").map(encodeURIComponent).join("/")}/index.html`;
  return name.kind === "job" ? address("jobs", { at: name.at }) : address("clip", { at: name.at });
}

function picture(name) {
  if (["folder", "job", "report"].includes(name.kind)) return el("span", { class: "sign" }, KINDS[name.kind]);
  const image = el("img", { class: "shot", alt: "", loading: "lazy", decoding: "async", width: 320, height: 180, "data-src": address("api/thumb", { at: name.at, side: 320 }) });
  return image;
}

function shown(name) {
  const what = [KINDS[name.kind], name.kind === "folder" || name.kind === "report" ? null : bytes(name.bytes), name.result ? "restored" : null];
  return el("li", { "data-name": name.name.toLowerCase() }, el("a", { href: link(name) },
    picture(name), el("b", {}, name.name), el("small", {}, what.filter(Boolean).join(", "))));
}

// Pictures are fetched once the list stands, and when they come near the window.
function lazily(list) {
  const watch = new IntersectionObserver((entries) => {
    for (const entry of entries) if (entry.isIntersecting) {
      const image = entry.target;
      watch.unobserve(image);
      image.addEventListener("error", () => image.replaceWith(el("span", { class: "sign" }, "no picture")), { once: true });
      image.src = image.dataset.src;
    }
  }, { rootMargin: "200px" });
  requestAnimationFrame(() => requestAnimationFrame(() => list.querySelectorAll("img[data-src]").forEach((image) => watch.observe(image))));
}

const open = attempting(async () => {
  const folder = await ask(address("api/folder", { at: here.get("at") || "" }));
  const last = folder.trail[folder.trail.length - 1];
  $("title").textContent = last.name;
  document.title = `${last.name} · rsvideo`;
  const parts = folder.trail.slice(0, -1).map((part) => el("a", { href: address("./", { at: part.at }) }, `${part.name} /`));
  const others = folder.folders.filter((other) => other.at !== folder.trail[0].at);
  $("trail").replaceChildren(...parts, ...others.map((other) => el("a", { href: address("./", { at: other.at }) }, `also: ${other.name}`)));
  const count = folder.names.filter((name) => name.kind === "clip" || name.kind === "sequence").length;
  const words = `${count} ${count === 1 ? "clip" : "clips"}, ${folder.names.length} names`;
  $("count").textContent = folder.more ? `${words}; there are more than can be listed here, put them into folders` : words;
  if (!folder.names.length) say("There are no clips, photographs or jobs in this folder; start rsvideo view with a folder that holds some.");
  $("names").replaceChildren(...folder.names.map(shown));
  lazily($("names"));
  ready();
});

$("filter").addEventListener("input", () => {
  const wanted = $("filter").value.trim().toLowerCase();
  for (const item of $("names").children) item.hidden = !item.dataset.name.includes(wanted);
});
open();
