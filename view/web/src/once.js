// Time for which the buttons stay inactive after a command, so that a double click sends one command.
export const COOLDOWN_MS = 500;

// Wraps `work` so that calls are dropped while one is in progress. Uses `aria-disabled`, since a `disabled` button loses the
// keyboard focus.
export function oneAtATime(buttons, work) {
  let busy = false;
  const show = () => { for (const button of buttons) button.setAttribute("aria-disabled", String(busy)); };
  return async (...args) => {
    if (busy) return;
    busy = true;
    show();
    try {
      await work(...args);
    } finally {
      setTimeout(() => {
        busy = false;
        show();
      }, COOLDOWN_MS);
    }
  };
}
