// What all pages share: asking the server, making elements, saying what went wrong in one sentence.
export const $ = (id) => document.getElementById(id);
export const here = new URLSearchParams(location.search);

export class Fault extends Error {
  constructor(words, faults) { super(words); this.faults = faults || {}; }
}

export async function ask(address, options = {}) {
  let answer;
  try {
    answer = await fetch(address, { cache: "default", ...options });
  } catch {
    throw new Fault("the server does not answer; start rsvideo view again, and open the address that it prints");
  }
  const values = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Fault(values.error || `the server answered ${answer.status}; reload the page`, values.faults);
  return values;
}

export const tell = (address, values) =>
  ask(address, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(values) });

// Names and words become text, never markup.
export function el(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) made.setAttribute(key, value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

export const address = (page, values) => `${page}?${new URLSearchParams(values)}`;

export function say(words, fault = false) {
  const place = $("say");
  place.textContent = words;
  place.classList.toggle("error", fault);
}

export const attempting = (work) => async (...given) => {
  try {
    return await work(...given);
  } catch (error) {
    say(error instanceof Fault ? error.message : `this page failed: ${error.message}; reload it`, true);
    if (!(error instanceof Fault)) throw error;
  }
};

export function clock(seconds) {
  if (seconds === null || seconds === undefined) return "";
  const s = Math.max(0, Math.round(seconds));
  const two = (n) => String(n).padStart(2, "0");
  return s < 60 ? `${s} s` : s < 3600 ? `${Math.floor(s / 60)}:${two(s % 60)} min` : `${Math.floor(s / 3600)}:${two(Math.floor(s / 60) % 60)} h`;
}

export function bytes(n) {
  if (n === null || n === undefined) return "";
  return n < 1e6 ? `${Math.max(1, Math.round(n / 1e3))} kB` : n < 1e9 ? `${(n / 1e6).toFixed(n < 1e7 ? 1 : 0)} MB` : `${(n / 1e9).toFixed(2)} GB`;
}

export const shortly = (value, digits = 4) => Number(value.toPrecision(digits)).toString();
export const ready = () => (document.documentElement.dataset.ready = "yes");
