// A double click is one command: until it is done, and a moment longer, the buttons do nothing.
export const REST_MS = 500;

// What does `work`, one at a time; what is asked for meanwhile is dropped. The buttons stay where the keyboard finds them:
// one that is `disabled` loses the focus, and who pressed it by a key would begin at the top of the page.
export function oneAtATime(buttons, work) {
  let busy = false;
  const show = () => { for (const button of buttons) button.setAttribute("aria-disabled", String(busy)); };
  return async (...what) => {
    if (busy) return;
    busy = true;
    show();
    try {
      await work(...what);
    } finally {
      setTimeout(() => {
        busy = false;
        show();
      }, REST_MS);
    }
  };
}
