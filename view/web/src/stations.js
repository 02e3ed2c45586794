// Page of several stations: a tile for each, with the joint closest to its limit, load, incidents and a link.
import { setLevel } from "./levels.js";
import { Stream, painter, setText } from "./stream.js";
import { applyTheme } from "./theme.js";
import { attention, tile } from "./tile.js";
import { capitalised, has, language, languageSwitch, t } from "./words.js";

const PILL = { waiting: "ui.connecting", live: "ui.live", silent: "ui.no_data", lost: "ui.no_connection" };
const element = (id) => document.getElementById(id);
const make = (kind, className) => Object.assign(document.createElement(kind), { className });
const tiles = new Map();

function newTile() {
  const entry = make("li", "card");
  const [head, title, link, phase] = [make("div", "tile-head"), make("h2", ""), make("a", ""), make("span", "soft")];
  const [worst, badge, joint, torque] = [make("p", "worst"), make("i", "badge"), make("b", ""), make("small", "")];
  const [load, incidents] = [make("p", ""), make("ul", "tile-incidents")];
  Object.assign(link, { target: "_blank", rel: "noreferrer" });
  badge.setAttribute("role", "img");
  title.append(link);
  head.append(title, phase);
  worst.append(badge, joint, torque);
  entry.append(head, worst, load, incidents);
  return { entry, link, phase, badge, joint, torque, load, incidents };
}

function show(parts, shown) {
  const { entry, link, phase, badge, joint, torque, load, incidents } = parts;
  Object.assign(entry.dataset, { station: shown.name, connection: shown.connection, level: shown.level });
  entry.classList.toggle("fault", attention(shown));
  link.href = shown.url;
  setText(link, shown.name);
  setText(phase, shown.phase && t(shown.phase));
  setLevel(badge, shown.level);
  badge.setAttribute("aria-label", t(`level.${shown.level}`));
  const [what, why] = t(shown.reason || " ").split(": ");
  setText(joint, shown.joint ? capitalised(t(shown.joint)) : what);
  // A station that refuses the request is on: its answer says what to do.
  const causes = /^\d{3}: /.test(shown.error) ? [shown.error] : [shown.error, why && capitalised(why)];
  setText(torque, shown.joint ? shown.torque : causes.filter(Boolean).join(" "));
  setText(load, `${t("ui.load")}: ${shown.load}`);
  const texts = shown.active.map((name) => (has(`incident.${name}.meaning`) ? t(`incident.${name}.meaning`) : name));
  if (!texts.length) texts.push(t(shown.known ? "ui.incidents_none" : "ui.incidents_unknown"));
  while (incidents.children.length > texts.length) incidents.lastChild.remove();
  texts.forEach((text, i) => {
    const line = incidents.children[i] ?? incidents.appendChild(document.createElement("li"));
    line.classList.toggle("soft", shown.active.length === 0);
    setText(line, text);
  });
}

function draw() {
  document.body.dataset.connection = stream.connection;
  setText(element("connection"), t(PILL[stream.connection]));
  const all = (stream.newest() ?? []).map((one) => tile(one, language()));
  setText(element("summary"), all.length ? t("ui.stations_summary", { count: all.length, attention: all.filter(attention).length }) : "");
  const order = [...all.filter(attention), ...all.filter((one) => !attention(one))];
  const entries = order.map((shown) => {
    if (!tiles.has(shown.url)) tiles.set(shown.url, newTile());
    show(tiles.get(shown.url), shown);
    return tiles.get(shown.url).entry;
  });
  const list = element("stations");
  if (entries.length !== list.children.length || entries.some((entry, i) => list.children[i] !== entry)) list.replaceChildren(...entries);
}

const redraw = painter(draw);
applyTheme(redraw);
const stream = new Stream("/events", ["stations"], redraw);
languageSwitch(element("languages"), draw);
