"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const all = (query, within = document) => [...within.querySelectorAll(query)];
  const data = JSON.parse($("data").textContent);
  const figures = all(".panel");
  const first = Object.fromEntries(figures.map((f) => [f.dataset.entry, f.querySelector("img").src]));
  const kept = new Map([[data.key, first]]);
  const picture = (keyFrame) => {
    if (!kept.has(keyFrame)) {
      const from = $(`key-frame-${keyFrame}`);
      kept.set(keyFrame, JSON.parse(from.textContent));
      from.remove();
    }
    return kept.get(keyFrame);
  };
  const state = { keyFrame: data.key, view: { x: 0, y: 0, w: data.cols } };
  const ratio = 4 / 3;

  // frames
  const left = $("left"), right = $("right");
  const display = () => {
    const shown = picture(state.keyFrame), captions = data.captions[state.keyFrame];
    for (const f of figures) {
      const name = f.dataset.entry, image = f.querySelector("img");
      f.classList.toggle("absent", !(name in shown));
      if (name in shown && image.src !== shown[name]) image.src = shown[name];
      f.querySelector(".value").textContent = name in shown ? captions[name] || "" : "not this frame";
    }
    pair();
    $("map").src = shown[right.value] || Object.values(shown)[0];
    const template = document.querySelector(`template[data-motion="${state.keyFrame}"]`);
    if (template) $("motions").replaceChildren(template.content.cloneNode(true));
    all(".frame-number").forEach((at) => (at.textContent = data.frames[state.keyFrame].index));
  };
  const pair = () => {
    const shown = picture(state.keyFrame), captions = data.captions[state.keyFrame];
    for (const [image, choice, tag] of [[$("over"), left, $("tag-left")], [$("under"), right, $("tag-right")]]) {
      const name = choice.value;
      if (name in shown) image.src = shown[name];
      image.alt = name;
      tag.textContent = captions[name] ? `${name}, ${captions[name]}` : name;
    }
  };
  left.addEventListener("change", pair);
  right.addEventListener("change", () => { pair(); $("map").src = picture(state.keyFrame)[right.value] || $("map").src; });
  all("input[name=frame]").forEach((radio) => radio.addEventListener("change", () => {
    state.keyFrame = Number(radio.value);
    display();
    const film = radio.closest(".film"), label = radio.closest("label");
    film.scrollLeft = label.offsetLeft - film.offsetLeft - (film.clientWidth - label.clientWidth) / 2;
  }));

  // the slider
  const stage = document.querySelector(".stage"), divider = $("divider");
  const scale = () => {
    const most = Math.min(window.innerHeight * 0.82 * data.cols / data.rows, data.cols * 4);
    stage.style.maxWidth = `${most}px`;
    stage.style.aspectRatio = `${data.cols} / ${data.rows}`;
  };
  const divide = () => {
    const at = Number(divider.value);
    document.querySelector(".over").style.clipPath = `inset(0 ${100 - at}% 0 0)`;
    document.querySelector(".handle").style.left = `${at}%`;
    divider.setAttribute("aria-valuetext", `${Math.round(at)} % ${left.value}, the rest ${right.value}`);
    $("tag-left").style.opacity = at > 12 ? 1 : 0;
    $("tag-right").style.opacity = at < 88 ? 1 : 0;
  };
  divider.addEventListener("input", divide);
  window.addEventListener("resize", scale);

  // the same part of every picture
  const view = state.view, panels = $("panels");
  const draw = () => {
    const h = view.w / ratio;
    for (const image of all(".pane img")) {
      image.style.width = `${100 * data.cols / view.w}%`;
      image.style.left = `${-100 * view.x / view.w}%`;
      image.style.top = `${-100 * view.y / h}%`;
    }
    const pane = document.querySelector(".pane");
    panels.classList.toggle("near", pane && pane.clientWidth / view.w > 2.5);
    const frame = $("frame").style;
    frame.left = `${100 * view.x / data.cols}%`;
    frame.top = `${100 * view.y / data.rows}%`;
    frame.width = `${100 * Math.min(view.w, data.cols) / data.cols}%`;
    frame.height = `${100 * Math.min(h, data.rows) / data.rows}%`;
    for (const key of ["x", "y", "w"]) if (document.activeElement !== $(key)) $(key).value = Math.round(view[key]);
    all(".crop").forEach((b) => {
      const [x, y, w, h2] = data.crops[b.dataset.crop];
      const [a, c, d] = around(x, y, w, h2);
      b.setAttribute("aria-pressed", Math.abs(a - view.x) < 1 && Math.abs(c - view.y) < 1 && Math.abs(d - view.w) < 1);
    });
  };
  const viewAt = (x, y, w) => {
    view.w = Math.max(16, Math.min(w, data.cols, data.rows * ratio));
    view.x = Math.max(0, Math.min(x, data.cols - view.w));
    view.y = Math.max(0, Math.min(y, data.rows - view.w / ratio));
    draw();
  };
  const around = (x, y, w, h) => {
    const wide = Math.min(Math.max(w, h * ratio), data.cols, data.rows * ratio), high = wide / ratio;
    return [Math.max(0, Math.min(x + (w - wide) / 2, data.cols - wide)), Math.max(0, Math.min(y + (h - high) / 2, data.rows - high)), wide];
  };
  const zoom = (factor, u = 0.5, v = 0.5) => {
    const w = Math.max(16, Math.min(view.w * factor, data.cols, data.rows * ratio));
    viewAt(view.x + u * (view.w - w), view.y + v * (view.w - w) / ratio, w);
  };
  all(".crop").forEach((b) => b.addEventListener("click", () => viewAt(...around(...data.crops[b.dataset.crop]))));
  $("in").addEventListener("click", () => zoom(1 / 1.5));
  $("out").addEventListener("click", () => zoom(1.5));
  $("whole").addEventListener("click", () => viewAt(0, 0, data.cols));
  for (const key of ["x", "y", "w"]) {
    $(key).max = key === "y" ? data.rows : data.cols;
    $(key).addEventListener("change", () => {
      const value = Number($(key).value);
      if (Number.isFinite(value)) viewAt(key === "x" ? value : view.x, key === "y" ? value : view.y, key === "w" ? value : view.w);
    });
  }
  panels.addEventListener("keydown", (event) => {
    const step = view.w / 8;
    const way = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (way) viewAt(view.x + way[0], view.y + way[1], view.w);
    else if (event.key === "+" || event.key === "=") zoom(1 / 1.5);
    else if (event.key === "-") zoom(1.5);
    else return;
    event.preventDefault();
  });
  let grip = null;
  panels.addEventListener("pointerdown", (event) => {
    const pane = event.target.closest(".pane");
    if (!pane || event.button) return;
    grip = { pane, x: event.clientX, y: event.clientY, from: { ...view } };
    pane.classList.add("dragged");
    pane.setPointerCapture(event.pointerId);
  });
  panels.addEventListener("pointermove", (event) => {
    if (!grip) return;
    const px = view.w / grip.pane.clientWidth;
    viewAt(grip.from.x - (event.clientX - grip.x) * px, grip.from.y - (event.clientY - grip.y) * px, view.w);
  });
  for (const kind of ["pointerup", "pointercancel"]) panels.addEventListener(kind, () => {
    if (grip) grip.pane.classList.remove("dragged");
    grip = null;
  });
  panels.addEventListener("wheel", (event) => {
    const pane = event.target.closest(".pane");
    if (!pane || !(event.ctrlKey || event.metaKey)) return; // a page that is scrolled stays a page that is scrolled
    event.preventDefault();
    const box = pane.getBoundingClientRect();
    zoom(Math.exp(event.deltaY / 300), (event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
  }, { passive: false });
  const overview = $("overview");
  let drawn = null;
  const place = (event) => {
    const box = overview.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width * data.cols, (event.clientY - box.top) / box.height * data.rows];
  };
  overview.addEventListener("pointerdown", (event) => { drawn = place(event); overview.setPointerCapture(event.pointerId); });
  overview.addEventListener("pointermove", (event) => {
    if (!drawn) return;
    const [x, y] = place(event), w = Math.abs(x - drawn[0]), h = Math.abs(y - drawn[1]);
    if (w > 12 || h > 12) viewAt(...around(Math.min(x, drawn[0]), Math.min(y, drawn[1]), w, h));
  });
  overview.addEventListener("pointerup", (event) => {
    const [x, y] = place(event);
    if (drawn && Math.hypot(x - drawn[0], y - drawn[1]) <= 12) viewAt(x - view.w / 2, y - view.w / ratio / 2, view.w);
    drawn = null;
  });
  overview.addEventListener("pointercancel", () => (drawn = null));

  // charts and video
  const measure = $("measure");
  if (measure) measure.addEventListener("change", () => all(".chart").forEach((c) => (c.hidden = c.dataset.chart !== measure.value)));
  const video = $("video");
  const frameVideo = () => {
    if (!video || !video.videoWidth) return;
    const most = `${Math.min(window.innerHeight * 0.84 * video.videoWidth / video.videoHeight, video.videoWidth * 2)}px`;
    $("bar").style.maxWidth = video.parentElement.style.maxWidth = most;
  };
  if (video) {
    const seek = $("seek"), play = $("play");
    video.controls = false;
    video.parentElement.classList.add("live");
    $("bar").hidden = false;
    video.addEventListener("loadedmetadata", frameVideo);
    window.addEventListener("resize", frameVideo);
    const toggle = () => (video.paused ? video.play() : video.pause());
    play.addEventListener("click", toggle);
    video.addEventListener("click", toggle);
    for (const kind of ["play", "pause"]) video.addEventListener(kind, () => (play.textContent = video.paused ? "play" : "pause"));
    const follow = () => {
      if (document.activeElement !== seek || !video.paused) seek.value = 1000 * video.currentTime / (video.duration || 1);
      if (!video.paused) requestAnimationFrame(follow);
    };
    video.addEventListener("play", follow);
    seek.addEventListener("input", () => { video.pause(); video.currentTime = seek.value / 1000 * (video.duration || 0); });
    $("speed").addEventListener("change", () => (video.playbackRate = Number($("speed").value)));
    frameVideo();
  }
  window.addEventListener("beforeprint", () => all("details").forEach((d) => { if (!d.closest(".chart")) d.open = true; }));

  panels.classList.add("live");
  scale();
  display();
  divide();
  if (data.crops.length) viewAt(...around(...data.crops[0])); else viewAt(0, 0, data.cols);
  document.documentElement.dataset.ready = "yes";
})();
