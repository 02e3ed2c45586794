// Texts in the selected language, from the tables that the server uses too.
import de from "../../src/words/de.json";
import en from "../../src/words/en.json";
import it from "../../src/words/it.json";

export const LANGUAGES = { en, de, it };
const STORAGE_KEY = "equipoise.language";

let code = "en";

// Text of a key; `values` replace the placeholders in braces. An unknown key is returned as it is.
export function t(key, values = {}) {
  const sentence = LANGUAGES[code][key] ?? en[key] ?? key;
  return sentence.replace(/\{(\w+)\}/g, (placeholder, name) => values[name] ?? placeholder);
}

export const language = () => code;
export const has = (key) => key in en;

// Browsers may block the storage; the choice is then lost when the page is closed.
function stored() {
  try { return localStorage.getItem(STORAGE_KEY); } catch { return null; }
}

// By priority: `?lang=`, the stored choice, the browser's languages, English.
export function preferred() {
  const candidates = [new URLSearchParams(location.search).get("lang"), stored(), ...(navigator.languages ?? [])];
  return candidates.map((one) => one?.slice(0, 2).toLowerCase()).find((one) => one in LANGUAGES) ?? "en";
}

export function setLanguage(chosen, store = false) {
  code = chosen;
  if (store) {
    try { localStorage.setItem(STORAGE_KEY, chosen); } catch { /* storage blocked */ }
  }
  document.documentElement.lang = chosen;
  for (const element of document.querySelectorAll("[data-t]")) element.textContent = t(element.dataset.t);
  for (const element of document.querySelectorAll("[data-t-label]")) element.setAttribute("aria-label", t(element.dataset.tLabel));
}

// Creates one button per language; calls `changed` after each choice.
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
  const choose = (one, store) => {
    setLanguage(one, store);
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.language === one));
    changed();
  };
  group.replaceChildren(...buttons);
  choose(preferred(), false);
}

export const capitalised = (text) => text.charAt(0).toUpperCase() + text.slice(1);

const POSES = Object.keys(en).filter((key) => key.startsWith("pose.")).map((key) => key.slice(5)).sort((a, b) => b.length - a.length);

// Translates a pose's English name. Additions of a model file to the name (a turn, a purpose) stay English.
export function pose(name) {
  const match = POSES.find((one) => name.includes(one));
  return match ? name.replace(match, t(`pose.${match}`)) : name;
}

// Translates an instruction; of a reason only the part before the colon.
export function instruction({ key, text, joint, pose: name }) {
  if (!has(key)) return text;
  if (key.startsWith("reason.")) return t(key).split(": ")[0];
  return t(key, { joint: joint && capitalised(t(`joint.${joint}`)), pose: name && pose(name) });
}

export const reason = ({ name, text }) => (has(`reason.${name}`) ? t(`reason.${name}`) : text);
