// Dark and light theme: `?theme=`, otherwise the browser's preference. The colours are those of base.css.
const resolved = new Map();
let probe = null;

export function applyTheme(changed) {
  const theme = new URLSearchParams(location.search).get("theme");
  if (theme === "dark" || theme === "light") {
    document.documentElement.dataset.theme = theme;
    for (const link of document.querySelectorAll("a.other")) link.search = `?theme=${theme}`;
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    resolved.clear();
    changed();
  });
}

// A colour of the theme by its name in base.css, as canvases need it: the property itself contains both themes.
export function colour(name) {
  if (!resolved.has(name)) {
    if (!probe) {
      probe = Object.assign(document.createElement("i"), { hidden: true });
      document.body.append(probe);
    }
    probe.style.color = `var(--${name})`;
    resolved.set(name, getComputedStyle(probe).color);
  }
  return resolved.get(name);
}
