// Command token, stored workers and command buttons. A command is a POST without a body, with the token in a custom header,
// which other sites cannot send (CORS). The token is stored only in the page's input field.
import { oneAtATime } from "./once.js";
import { setText } from "./stream.js";
import { t } from "./words.js";

// Longer than any command takes. Without it, a lost connection would block the buttons.
const RESPONSE_TIMEOUT_MS = 30_000;
const UNAUTHORISED = 401;
// The token was accepted, but the list of workers cannot be read: an id is entered as text.
const UNLISTED = 500;
// A shorter token is checked when the field is left.
const TOKEN_CHARS_MIN = 32;

export function commands(element) {
  const buttons = [...document.querySelectorAll("[data-command]")];
  const workers = element("subject");
  let accepted = false;
  const enable = () => {
    for (const button of buttons) button.disabled = !accepted || (button.dataset.command === "subject-load" && !workers.value);
    workers.disabled = !accepted;
  };
  const command = oneAtATime(buttons, send);
  for (const button of buttons) button.addEventListener("click", () => command(button.dataset.command));
  workers.addEventListener("input", enable);
  element("token").addEventListener("input", ({ target }) => check(target.value.length >= TOKEN_CHARS_MIN));
  element("token").addEventListener("change", ({ target }) => { if (!accepted) check(target.value.length > 0); });
  enable();

  async function request(address, options = {}) {
    const response = await fetch(address, {
      ...options, headers: { "X-Equipoise-Command": element("token").value }, signal: AbortSignal.timeout(RESPONSE_TIMEOUT_MS),
    });
    return { ok: response.ok, status: response.status, text: response.status === UNAUTHORISED ? t("ui.token_wrong") : (await response.text()).trim() };
  }

  // Only the holder of the token gets the list of workers: its request checks the token.
  async function check(isComplete) {
    accepted = false;
    showToken("", "");
    enable();
    if (!isComplete) return;
    const token = element("token").value;
    const answer = await request("/api/subjects").catch(() => ({ ok: false, text: t("reason.lost") }));
    if (token !== element("token").value) return;
    accepted = answer.ok || answer.status === UNLISTED;
    showToken(accepted ? "done" : "refused", accepted ? t("ui.token_accepted") : answer.text);
    list(answer.ok ? JSON.parse(answer.text) : []);
    if (answer.ok && !workers.list.options.length) workers.placeholder = t("ui.worker_none");
    if (accepted && !answer.ok) showReply("refused", answer.text);
    enable();
  }

  function list(ids) {
    workers.placeholder = ids.length ? t("ui.worker_choose") : "";
    workers.list.replaceChildren(...ids.map((id) => Object.assign(document.createElement("option"), { value: id })));
  }

  async function send(name) {
    if (name === "identify-reset" && !window.confirm(t("ui.sure"))) return;
    showReply("pending", t("ui.asking"));
    const subject = name === "subject-load" ? `/${encodeURIComponent(workers.value)}` : "";
    try {
      const { ok, text } = await request(`/api/command/${name}${subject}`, { method: "POST" });
      showReply(ok ? "done" : "refused", text);
    } catch {
      showReply("refused", t("reason.lost"));
    }
  }

  function showToken(kind, text) {
    element("token-state").dataset.kind = kind;
    element("token").setAttribute("aria-invalid", String(kind === "refused"));
    setText(element("token-state"), text);
  }

  function showReply(kind, text) {
    element("reply").dataset.kind = kind;
    element("reply").textContent = text;
  }
}
