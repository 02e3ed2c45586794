// Display of the overload levels: the table that terminal, report and Foxglove use too.
import table from "../../src/levels.json";

export const LEVELS = Object.fromEntries(table.map((level) => [level.name, level]));

// Sets a badge to a level: colour, and sign for readers who do not distinguish the colours.
export function setLevel(badge, name) {
  const { colour, ink, sign } = LEVELS[name] ?? LEVELS.none;
  badge.dataset.level = name;
  badge.style.background = colour;
  badge.style.color = ink;
  if (badge.textContent !== sign) badge.textContent = sign;
}
