// Sentences in the reader's language. The tables are those that the service itself speaks from.
import de from "../../src/words/de.json";
import en from "../../src/words/en.json";
import it from "../../src/words/it.json";

export const LANGUAGES = { en, de, it };
const KEPT_AS = "equipoise.language";

let code = "en";

// `values` stand in the sentence for what is in braces. A key that no table has is shown as it is.
export function t(key, values = {}) {
  const sentence = LANGUAGES[code][key] ?? en[key] ?? key;
  return sentence.replace(/\{(\w+)\}/g, (place, name) => values[name] ?? place);
}

export const language = () => code;
export const has = (key) => key in en;

// A stopped browser's storage may refuse; the choice is then forgotten with the page.
function kept() {
  try { return localStorage.getItem(KEPT_AS); } catch { return null; }
}

// The address says it, or what was chosen here before, or what the browser prefers.
export function preferred() {
  const asked = [new URLSearchParams(location.search).get("lang"), kept(), ...(navigator.languages ?? [])];
  return asked.map((one) => one?.slice(0, 2).toLowerCase()).find((one) => one in LANGUAGES) ?? "en";
}

export function speak(chosen, keep = false) {
  code = chosen;
  if (keep) {
    try { localStorage.setItem(KEPT_AS, chosen); } catch { /* as above */ }
  }
  document.documentElement.lang = chosen;
  for (const element of document.querySelectorAll("[data-t]")) element.textContent = t(element.dataset.t);
  for (const element of document.querySelectorAll("[data-t-label]")) element.setAttribute("aria-label", t(element.dataset.tLabel));
}

// One button a language; `changed` is called after a choice.
export function languageSwitch(group, changed) {
  const buttons = Object.keys(LANGUAGES).map((one) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = one.toUpperCase();
    button.lang = one;
    button.title = LANGUAGES[one]["ui.language"];
    button.dataset.language = one;
    button.addEventListener("click", () => choose(one, true));
    return button;
  });
  const choose = (one, keep) => {
    speak(one, keep);
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.language === one));
    changed();
  };
  group.replaceChildren(...buttons);
  choose(preferred(), false);
}

export const capitalised = (text) => text.charAt(0).toUpperCase() + text.slice(1);

const POSES = Object.keys(en).filter((key) => key.startsWith("pose.")).map((key) => key.slice(5)).sort((a, b) => b.length - a.length);

// A pose's English name in the reader's language. What a model file adds to a name (a turn, a purpose) stays as it is.
export function pose(name) {
  const known = POSES.find((one) => name.includes(one));
  return known ? name.replace(known, t(`pose.${known}`)) : name;
}

// What the service says, in the reader's language; of a reason only what stands before its colon.
export function instruction({ key, text, joint, pose: name }) {
  if (!has(key)) return text;
  if (key.startsWith("reason.")) return t(key).split(": ")[0];
  return t(key, { joint: joint && capitalised(t(`joint.${joint}`)), pose: name && pose(name) });
}

export const reason = ({ name, text }) => (has(`reason.${name}`) ? t(`reason.${name}`) : text);
