// Tabs by the pattern of the ARIA Authoring Practices. The address names the selected one: #latency.
const KEYS = { ArrowLeft: -1, ArrowRight: 1 };

export function tabs(list) {
  const buttons = [...list.querySelectorAll("[role=tab]")];
  const panelOf = (button) => document.getElementById(button.getAttribute("aria-controls"));
  const select = (chosen) => {
    for (const button of buttons) {
      button.setAttribute("aria-selected", String(button === chosen));
      button.tabIndex = button === chosen ? 0 : -1;
      panelOf(button).hidden = button !== chosen;
    }
  };
  const named = () => buttons.find((button) => `#${button.dataset.tab}` === location.hash) ?? buttons[0];
  const choose = (button) => {
    history.replaceState(null, "", `#${button.dataset.tab}`);
    select(button);
  };
  for (const [i, button] of buttons.entries()) {
    button.addEventListener("click", () => choose(button));
    button.addEventListener("keydown", ({ key }) => {
      if (!KEYS[key]) return;
      const next = buttons[(i + KEYS[key] + buttons.length) % buttons.length];
      choose(next);
      next.focus();
    });
  }
  window.addEventListener("hashchange", () => select(named()));
  select(named());
}

// Explained terms: shown on hover and keyboard focus (engineer.css), by a click where neither exists, closed by Escape.
export function explanations() {
  for (const term of document.querySelectorAll(".term")) {
    term.addEventListener("click", () => term.focus());
    term.addEventListener("keydown", ({ key }) => { if (key === "Escape") term.blur(); });
  }
}
