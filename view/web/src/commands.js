// Command buttons. A command is a POST without a body, with the token in a custom header, which other sites cannot send
// (CORS). The token is stored only in the page's input field.
import { oneAtATime } from "./once.js";
import { t } from "./words.js";

// Longer than any command takes. Without it, a lost connection would block the buttons.
const RESPONSE_TIMEOUT_MS = 30_000;
const UNAUTHORISED = 401;

export function commands(element) {
  const buttons = [...document.querySelectorAll("[data-command]")];
  const enable = () => {
    for (const button of buttons) {
      button.disabled = !element("token").value || (button.dataset.command === "subject-load" && !element("subject").value);
    }
  };
  const command = oneAtATime(buttons, send);
  for (const id of ["token", "subject"]) element(id).addEventListener("input", enable);
  for (const button of buttons) button.addEventListener("click", () => command(button.dataset.command));
  enable();

  async function send(name) {
    if (name === "identify-reset" && !window.confirm(t("ui.sure"))) return;
    showReply("pending", t("ui.asking"));
    const subject = name === "subject-load" ? `/${encodeURIComponent(element("subject").value)}` : "";
    try {
      const response = await fetch(`/api/command/${name}${subject}`, {
        method: "POST", headers: { "X-Equipoise-Command": element("token").value }, signal: AbortSignal.timeout(RESPONSE_TIMEOUT_MS),
      });
      showReply(response.ok ? "done" : "refused", response.status === UNAUTHORISED ? t("ui.token_wrong") : (await response.text()).trim());
    } catch {
      showReply("refused", t("reason.lost"));
    }
  }

  function showReply(kind, text) {
    element("reply").dataset.kind = kind;
    element("reply").textContent = text;
  }
}
