"""Opens a page in headless Chromium and looks at it: page.py [--daemon PID] URL SERVER-COMMAND...

With a daemon beside the server, it is the daemon that dies first, and the page must say so; then the server.

Chromium is spoken to over its debugging pipe, so that nothing but Python's own library is needed. The pictures on the
page are canvases: whether a figure is there is told by their pixels.
"""

import fcntl
import json
import os
import select
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request

START_S = 60.0
LOOK_S = 45.0
# Coloured (not grey) pixels of a figure's bones and joints; an empty canvas has a grey grid and a grey sentence.
FIGURE_PIXELS_MIN = 1500

CHROMIUM = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
            "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
            "--window-size=1200,900", "--remote-debugging-pipe"]

LOOK = """(() => {
  const canvas = document.getElementById("figure");
  const text = (id) => document.getElementById(id)?.textContent ?? "";
  let coloured = 0;
  if (canvas?.width && canvas?.height) {
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    for (let i = 0; i < data.length; i += 4) {
      const [r, g, b, a] = data.slice(i, i + 4);
      if (a > 128 && Math.max(r, g, b) - Math.min(r, g, b) > 60) coloured += 1;
    }
  }
  return JSON.stringify({
    connection: document.body?.dataset.connection, phase: document.body?.dataset.phase, phaseText: text("phase"),
    instruction: text("instruction"), coloured,
  });
})()"""

NOTHING = {"connection": None, "phase": "", "phaseText": "", "instruction": "", "coloured": 0}


class Browser:
    """One tab of a Chromium of its own."""

    def __init__(self, profile):
        to_browser, from_us = os.pipe()
        to_us, from_browser = os.pipe()
        # Out of the way of 3 and 4, where Chromium expects its ends.
        reads = fcntl.fcntl(to_browser, fcntl.F_DUPFD, 10)
        writes = fcntl.fcntl(from_browser, fcntl.F_DUPFD, 10)
        os.close(to_browser)
        os.close(from_browser)
        from_us, to_us = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (from_us, to_us))

        def place():
            os.dup2(reads, 3)
            os.dup2(writes, 4)

        self.process = subprocess.Popen([*CHROMIUM, f"--user-data-dir={profile}", "about:blank"], preexec_fn=place,
                                        pass_fds=(3, 4), stderr=subprocess.DEVNULL)
        os.close(reads)
        os.close(writes)
        self.to, self.of = from_us, to_us
        self.buffer, self.number, self.errors, self.session = b"", 0, [], None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.ask(f"{domain}.enable")

    def ask(self, method, **params):
        self.number += 1
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + 30.0
        while True:
            answer = self.next_message(until)
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(answer["params"]["exceptionDetails"].get("text", "exception"))
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def next_message(self, until):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.of], [], [], max(0.0, until - time.monotonic()))
            chunk = os.read(self.of, 1 << 16) if ready else b""
            if not chunk:
                raise RuntimeError("the browser does not answer")
            self.buffer += chunk
        line, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(line)

    def look(self):
        # Between two documents there is little or nothing to look at.
        value = self.ask("Runtime.evaluate", expression=LOOK)["result"].get("value")
        return NOTHING | json.loads(value or "{}")

    def look_until(self, wanted, what):
        until = time.monotonic() + LOOK_S
        while not wanted(seen := self.look()):
            if time.monotonic() > until:
                raise RuntimeError(f"the page never showed {what}; it shows {seen}")
            time.sleep(0.25)
        return seen

    def close(self):
        self.process.terminate()
        self.process.wait(20)


def wait_for(url, server):
    until = time.monotonic() + START_S
    while time.monotonic() < until:
        if server.poll() is not None:
            raise RuntimeError(f"the service ended with {server.returncode} before it served {url}")
        try:
            return urllib.request.urlopen(url, timeout=2).read()
        except OSError:
            time.sleep(0.2)
    raise RuntimeError(f"{url} was not served within {START_S} s")


def nothing_shown(seen):
    return not seen["phase"] and seen["coloured"] <= FIGURE_PIXELS_MIN


def check(url, server, browser, daemon):
    browser.ask("Page.navigate", url=url)
    seen = browser.look_until(
        lambda seen: seen["connection"] == "live" and seen["phase"] and seen["phaseText"]
        and seen["coloured"] > FIGURE_PIXELS_MIN, "a live figure and a phase")
    print(f"page: shows \"{seen['phaseText']}\" ({seen['phase']}), \"{seen['instruction']}\", and a figure of "
          f"{seen['coloured']} pixels")
    # Nobody may take an old picture for a live one.
    if daemon:
        os.kill(daemon, signal.SIGKILL)
        gone = browser.look_until(lambda seen: seen["connection"] == "silent" and nothing_shown(seen),
                                  "that the daemon is gone")
        print(f"page: after the daemon was killed it says \"{gone['instruction']}\" and shows no figure")
        if server.poll() is not None:
            raise RuntimeError(f"the page's process ended with {server.returncode} when the daemon was killed")
    server.kill()
    server.wait()
    ends = ("lost",) if daemon else ("lost", "silent")
    gone = browser.look_until(lambda seen: seen["connection"] in ends and nothing_shown(seen),
                              "that the service is gone")
    print(f"page: after the service was killed it says \"{gone['instruction']}\" and shows no figure")
    if browser.errors:
        raise RuntimeError(f"errors in the page's scripts: {browser.errors}")


def main():
    arguments, daemon = sys.argv[1:], None
    if arguments[0] == "--daemon":
        daemon, arguments = int(arguments[1]), arguments[2:]
    url, command = arguments[0], arguments[1:]
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        server = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        browser = None
        try:
            wait_for(url, server)
            browser = Browser(profile)
            check(url, server, browser, daemon)
        except (RuntimeError, OSError) as error:
            sys.exit(f"page: {error}")
        finally:
            if browser:
                browser.close()
            if server.poll() is None:
                server.kill()
                server.wait()


if __name__ == "__main__":
    main()
