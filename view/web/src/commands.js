// The buttons. A command is a POST without a body that brings the token in a header of its own, which no other site can send;
// the token is in this page's field and nowhere else.
import { oneAtATime } from "./once.js";
import { t } from "./words.js";

// Longer than any command takes. On a connection whose other end is gone an answer never comes, and buttons would wait for it.
const ANSWER_WITHIN_MS = 30_000;

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
    tell("asking", t("ui.asking"));
    const subject = name === "subject-load" ? `/${encodeURIComponent(element("subject").value)}` : "";
    try {
      const answer = await fetch(`/api/command/${name}${subject}`, {
        method: "POST", headers: { "X-Equipoise-Command": element("token").value }, signal: AbortSignal.timeout(ANSWER_WITHIN_MS),
      });
      tell(answer.ok ? "done" : "refused", (await answer.text()).trim());
    } catch {
      tell("refused", t("reason.lost"));
    }
  }

  function tell(kind, text) {
    element("reply").dataset.kind = kind;
    element("reply").textContent = text;
  }
}
