"""Executes clients/opcua/equipoise.st (IEC 61131-3) as Python: opcua-program.py PATH.

Only the subset of structured text that the program uses is translated.
"""

import pathlib
import re
import sys

CYCLE_MS = 10
UPDATE_MS = 50
GOOD, BAD = 0x00000000, 0x80000000
BELOW_LOAD_THRESHOLD, SUIT_STALE, MOVING = 1 << 5, 1 << 0, 1 << 3
NONE, GREEN, ORANGE, UNDECIDED = 0, 1, 2, 5


class Ton:
    """On-delay timer."""

    def __init__(self, clock):
        self.clock, self.since_ms, self.ET, self.Q = clock, None, 0, False

    def __call__(self, IN, PT=0):
        self.since_ms = (self.clock.now_ms if self.since_ms is None else self.since_ms) if IN else None
        self.ET = min(self.clock.now_ms - self.since_ms, PT) if IN else 0
        self.Q = bool(IN) and self.ET >= PT


def expression(text):
    """An expression of structured text as Python."""
    text = re.sub(r"\bT#(\d+)ms", r"\1", text)
    text = re.sub(r"\bAND 16#([0-9A-F]+)", r"& 0x\1", text)
    text = re.sub(r"16#([0-9A-F]+)", r"0x\1", text)
    text = re.sub(r"(?<![<>:])=", "==", text).replace("<>", "!=").replace(":=", "=")
    for word, python in {"AND": "and", "OR": "or", "NOT": "not", "TRUE": "True", "FALSE": "False", "TIME_TO_ULINT": ""}.items():
        text = re.sub(rf"\b{word}\b", python, text)
    return text.strip()


class Program:
    """The program with its variables, and a client that writes them."""

    def __init__(self, path):
        self.now_ms = 0
        text = re.sub(r"\(\*.*?\*\)", "", pathlib.Path(path).read_text(), flags=re.DOTALL)
        self.variables = {}
        for declarations in re.findall(r"\bVAR\b(.*?)\bEND_VAR\b", text, flags=re.DOTALL):
            for names, kind, value in re.findall(r"([\w, ]+?)\s*:\s*(\w+)\s*(?::=\s*([^;]+))?;", declarations):
                for name in names.split(","):
                    initial = Ton(self) if kind == "TON" else eval(expression(value)) if value else 0
                    self.variables[name.strip()] = initial
        lines, depth = [], 0
        pattern = r"\s*(?:(ELSIF|IF)\b(.*?)\bTHEN|(ELSE\b|END_IF;)|([^;]+);)"
        body = " ".join(text.rpartition("END_VAR")[2].split())
        for control, condition, word, statement in re.findall(pattern, body):
            depth -= control == "ELSIF" or word != ""
            if statement:
                lines.append("  " * depth + expression(statement.strip()))
            elif word != "END_IF;":
                start = {"IF": "if ", "ELSIF": "elif "}.get(control, "else")
                lines.append(f"{'  ' * depth}{start}{expression(condition)}:")
                depth += 1
        self.code = compile("\n".join(lines), "the program as Python", "exec")

    def run(self, seconds, is_alive=True, **values):
        """Runs cyclically with these values; while the gateway is alive the sequence increases with each update."""
        self.variables.update(values)
        for _ in range(round(1000 * seconds / CYCLE_MS)):
            self.now_ms += CYCLE_MS
            if is_alive and self.now_ms % UPDATE_MS == 0:
                self.variables["Sequence"] += 10
            exec(self.code, {}, self.variables)
        return self.variables["SpeedOverride"]


def main(path):
    program = Program(path)
    loaded = {"ValidStatus": GOOD, "Valid": 0, "Usable": True, "LevelStatus": GOOD, "Level": GREEN}
    # What the gateway publishes while the worker carries nothing: values of bad nodes are 0.
    unloaded = {**loaded, "Valid": BELOW_LOAD_THRESHOLD, "Usable": False, "LevelStatus": BAD, "Level": NONE}
    assert program.run(2) == 0, "it moves without a connection"
    connected = {"SequenceStatus": GOOD, "AgeStatus": GOOD, "AgeNs": 5_000_000, "UsableStatus": GOOD}
    assert program.run(0.4, **connected, **loaded) == 0, "it moves before the sequence has changed for 0.4 s"
    for level, speed in {GREEN: 100, ORANGE: 30, UNDECIDED: 30, NONE: 0, 6: 0}.items():
        assert program.run(1, **{**loaded, "Level": level}) == speed, f"level {level}"
    for bad in ({"LevelStatus": BAD}, {"UsableStatus": BAD}, {"Usable": False}):
        assert program.run(0.1, **{**loaded, **bad}) == 0, f"it moves with {bad}"
        assert program.run(0.1, **loaded, UsableStatus=GOOD) == 100
    assert program.run(1, **unloaded) == 100, "the machine stands still while the worker carries nothing"
    for valid in (BELOW_LOAD_THRESHOLD | SUIT_STALE, BELOW_LOAD_THRESHOLD | MOVING, SUIT_STALE, 0):
        assert program.run(0.1, **{**unloaded, "Valid": valid}) == 0, f"it moves with {valid}"
    assert program.run(0.1, **{**unloaded, "ValidStatus": BAD}) == 0, "it uses a bad value"
    for state in (loaded, unloaded):
        assert program.run(1, **state) == 100
        assert program.run(0.1, **state, AgeNs=200_000_000) == 0, "it moves by an old state"
        assert program.run(0.1, AgeNs=5_000_000) == 100
        assert program.run(0.1, AgeStatus=BAD) == 0, "it uses a bad age"
        assert program.run(0.1, AgeStatus=GOOD) == 100
        assert program.run(0.25, is_alive=False) == 0, "it moves without updates"
        assert program.run(0.3) == 0, "it moves at once after a pause"
        assert program.run(0.3) == 100
    print("opcua: the program in structured text stops without a state, and moves by the level or without a load")


if __name__ == "__main__":
    try:
        main(sys.argv[1])
    except AssertionError as error:
        sys.exit(f"opcua: {error}")
