// List of incidents: active ones whole, ended ones as a line that opens.
import { setText } from "./stream.js";
import { has, t } from "./words.js";

export function span(seconds) {
  return seconds < 120 ? `${seconds.toFixed(0)} s` : seconds < 7200 ? `${(seconds / 60).toFixed(0)} min` : `${(seconds / 3600).toFixed(0)} h`;
}

const translated = (name, part, fallback) => (has(`incident.${name}.${part}`) ? t(`incident.${name}.${part}`) : fallback);

function item({ name, active }) {
  const entry = document.createElement("li");
  entry.dataset.incident = name;
  entry.classList.toggle("active", active);
  const [head, when, message, remedy] = ["b", "small", "span", "span"].map((kind) => document.createElement(kind));
  const box = document.createElement(active ? "div" : "details");
  const summary = document.createElement(active ? "div" : "summary");
  summary.append(head, when);
  box.append(summary, message, remedy);
  entry.append(box);
  return { entry, active, texts: [head, when, message, remedy] };
}

export class IncidentList {
  constructor(list) {
    this.list = list;
    this.items = new Map();
  }

  // `incidents` is null if no daemon publishes them: unknown, not none. Entries are kept, and with them focus and opened ones.
  show(incidents) {
    const sorted = [...(incidents ?? [])].sort((a, b) => Number(b.active) - Number(a.active));
    const items = new Map(sorted.map((one) => {
      const kept = this.items.get(one.name);
      return [one.name, kept?.active === one.active ? kept : item(one)];
    }));
    for (const one of sorted) {
      const [head, when, message, remedy] = items.get(one.name).texts;
      setText(head, translated(one.name, "meaning", one.name));
      setText(when, `${one.name}: ${one.active ? t("ui.goes_on", { span: span(one.duration_s) }) : t("ui.was", { count: one.count, span: span(one.ended_ago_s) })}`);
      setText(message, one.message ?? "");
      const todo = translated(one.name, "do", "");
      setText(remedy, todo && `${t("ui.to_do")}: ${todo}`);
    }
    const entries = [...items.values()].map(({ entry }) => entry);
    if (entries.length) {
      if (entries.some((entry, i) => this.list.children[i] !== entry) || this.list.children.length !== entries.length) this.list.replaceChildren(...entries);
    } else {
      const none = Object.assign(document.createElement("li"), { className: "soft" });
      setText(none, t(incidents ? "ui.incidents_none" : "ui.incidents_unknown"));
      this.list.replaceChildren(none);
    }
    this.items = items;
  }
}
