"""Dashboards of examples/grafana: structure, Grafana's schema (`@grafana/schema`), queries against a Prometheus.

grafana.py schema FOLDER: checks the structure of all dashboards and writes FOLDER/dashboards.ts, whose compilation
compares each with the types of the schema.
grafana.py query PROMETHEUS INSTANCE SUIT-PORT SIMULATION: every query of the dashboard "prometheus" returns data of a
station with a simulated human who lifts; SIMULATION is the process of its sensors, which is ended.
"""

import json
import os
import pathlib
import re
import signal
import socket
import sys
import time
import urllib.error
import urllib.parse
import urllib.request

ROOT = pathlib.Path(__file__).parent.parent
FOLDER = ROOT / "examples/grafana"
LEVELS = {level["name"]: level["colour"] for level in json.loads((ROOT / "view/src/levels.json").read_text())}
# Panel type: module of the schema with the types of its options and field settings.
MODULES = {
    "barchart": "BarChart",
    "bargauge": "BarGauge",
    "stat": "Stat",
    "state-timeline": "StateTimeline",
    "table": "Table",
    "timeseries": "TimeSeries",
}
# Settings of the panel's editor that its schema does not list.
UNLISTED = {"state-timeline": ("spanNulls", "insertNulls")}
PATIENCE_S = 90
# Grown, not only there: a counter whose first sample is already 1 has not increased for a Prometheus.
REFUSED = 'increase(equipoise_adapter_refused_total{stream="suit"}[10s]) > 0'
# JSON has the values of enumerations in place of their members.
TYPES = """type Json<T> = unknown extends T ? T
  : T extends string ? `${T}`
  : T extends number ? (`${T}` extends `${infer N extends number}` ? N : T)
  : T extends (infer U)[] ? Json<U>[]
  : T extends object ? { [K in keyof T]: Json<T[K]> }
  : T;
"""


def load(name):
    return json.loads((FOLDER / f"{name}.json").read_text())


def panels(dashboard):
    """All panels with a query."""
    return [panel for panel in dashboard["panels"] if panel["type"] != "row"]


def overlap(one, other):
    def apart(start, size):
        return one[start] + one[size] <= other[start] or other[start] + other[size] <= one[start]

    return not (apart("x", "w") or apart("y", "h"))


def check_structure(dashboard):
    name = dashboard["title"]
    ids = [panel["id"] for panel in dashboard["panels"]]
    assert len(set(ids)) == len(ids), f"{name}: panel ids {ids}"
    assert dashboard["schemaVersion"] >= 39 and dashboard["uid"], name
    variables = [variable["name"] for variable in dashboard["templating"]["list"]]
    assert {"datasource", "station"} <= set(variables), f"{name}: variables {variables}"
    used = set(re.findall(r"\$\{?([a-z]\w*)", json.dumps(dashboard)))
    assert used <= set(variables), f"{name}: undefined variables {used - set(variables)}"
    for index, panel in enumerate(dashboard["panels"]):
        grid = panel["gridPos"]
        assert grid["x"] + grid["w"] <= 24, f"{name}: {panel['title']} is too wide"
        for other in dashboard["panels"][:index]:
            assert not overlap(grid, other["gridPos"]), f"{name}: {panel['title']} is on {other['title']}"
    for panel in panels(dashboard):
        title = f"{name}: {panel['title']}"
        assert panel["description"] and panel["targets"], f"{title} has no description or query"
        references = [target["refId"] for target in panel["targets"]]
        assert len(set(references)) == len(references), f"{title}: {references}"
        fields = panel["fieldConfig"]
        custom = fields["defaults"].get("custom", {})
        if panel["type"] in ("timeseries", "state-timeline"):
            assert custom["spanNulls"] is False, f"{title} draws across gaps"
        if panel["type"] in ("timeseries", "barchart", "bargauge"):
            assert "unit" in fields["defaults"], f"{title} has no unit"
        # A missing value is displayed as text.
        assert panel["type"] != "stat" or "noValue" in fields["defaults"], title
        for override in fields["overrides"]:
            level = override["matcher"]["options"]
            for setting in override["properties"]:
                if setting["id"] == "color":
                    assert setting["value"]["fixedColor"] == LEVELS[level], f"{title}: colour of {level}"
        for mapping in fields["defaults"].get("mappings", []):
            for value, result in mapping["options"].items():
                if value in LEVELS:
                    assert result["color"] == LEVELS[value], f"{title}: colour of {value}"


def typescript(names):
    """A module that compiles if every dashboard agrees with the schema."""
    modules = {kind: f"{module}PanelCfg_types.gen" for kind, module in MODULES.items()}
    lines = ["import type { Dashboard } from '@grafana/schema';"]
    for kind, module in modules.items():
        folder = kind.replace("-", "")
        path = f"@grafana/schema/dist/esm/raw/composable/{folder}/panelcfg/x/{module}"
        lines.append(f"import type * as {folder} from '{path}';")
    lines.append(TYPES)
    for name in names:
        dashboard = load(name)
        lines.append(f"export const {name}: Json<Dashboard> = {json.dumps(dashboard)};")
        for panel in panels(dashboard):
            kind, constant = panel["type"].replace("-", ""), f"{name}_{panel['id']}"
            lines.append(f"export const {constant}: Json<{kind}.Options> = {json.dumps(panel['options'])};")
            custom = dict(panel["fieldConfig"]["defaults"].get("custom", {}))
            for key in UNLISTED.get(panel["type"], ()):
                custom.pop(key, None)
            if custom:
                lines.append(f"export const {constant}_custom: Json<{kind}.FieldConfig> = {json.dumps(custom)};")
    return "\n".join(lines) + "\n"


class Prometheus:
    """The HTTP interface of a Prometheus, and the variables of the dashboard."""

    def __init__(self, url, variables, interval_s):
        self.url, self.variables, self.interval_s = url, variables, interval_s
        self.start_s = time.time()

    def expand(self, expression, range_s):
        variables = {**self.variables, "__range": f"{range_s}s", "__rate_interval": f"{4 * self.interval_s}s"}
        return re.sub(r"\$(\w+)", lambda match: variables[match[1]], expression)

    def wait_until_ready(self):
        end = time.monotonic() + PATIENCE_S
        while True:
            try:
                urllib.request.urlopen(f"{self.url}/-/ready", timeout=10).close()
                return
            except OSError as error:
                assert time.monotonic() < end, error
                time.sleep(0.2)

    def get(self, path, **parameters):
        url = f"{self.url}/api/v1/{path}?{urllib.parse.urlencode(parameters)}"
        try:
            with urllib.request.urlopen(url, timeout=10) as response:
                return json.load(response)["data"]
        except urllib.error.HTTPError as error:
            raise AssertionError(f"{parameters}: {error.read().decode()}") from error

    def query(self, target):
        """Number of samples other than NaN that a target of a panel returns."""
        end_s = time.time()
        expression = self.expand(target["expr"], int(end_s - self.start_s) + 1)
        if target.get("instant"):
            data = self.get("query", query=expression, time=end_s)
        else:
            data = self.get("query_range", query=expression, start=self.start_s, end=end_s, step=self.interval_s)
        samples = [sample for series in data["result"] for sample in series.get("values", [series.get("value")])]
        return sum(value != "NaN" for _, value in samples)

    def without_data(self, dashboard):
        """Title and expression of the queries that return no data."""
        for panel in panels(dashboard):
            for target in panel["targets"]:
                if not self.query(target):
                    yield panel["title"], target["expr"]

    def check_variables(self, dashboard):
        """The queries of the variables return the values in use."""
        for variable in dashboard["templating"]["list"]:
            if variable["type"] == "query":
                selector, label = re.fullmatch(r"label_values\((.*), (\w+)\)", variable["query"]["query"]).groups()
                expected = self.variables[variable["name"]]
                found = self.get(f"label/{label}/values", **{"match[]": self.expand(selector, 1)})
                assert found == [expected], f"{variable['name']}: {found}, not {expected}"


def fields_of(payloads):
    """Fields of the MQTT data source for these messages: the top-level keys of an object, or `Value`; null is a gap."""
    rows = []
    for payload in payloads:
        try:
            row = json.loads(payload)
        except ValueError:
            row = payload
        rows.append(row if isinstance(row, dict) else {"Value": row})
    names = {name for row in rows for name, value in row.items() if value is not None}
    return {name: [row.get(name) for row in rows] for name in names} | {"Time": list(range(len(rows)))}


def transform(fields, steps):
    for step in steps:
        options = step["options"]
        if step["id"] == "filterFieldsByName":
            fields = {name: fields[name] for name in options["include"]["names"]}
        elif step["id"] == "extractFields":
            assert options["replace"] and options["keepTime"]
            rows = [row or {} for row in fields[options["source"]]]
            names = {name for row in rows for name in row}
            fields = {name: [row.get(name) for row in rows] for name in names} | {"Time": fields["Time"]}
        else:
            assert step["id"] in ("sortBy", "limit"), step
    return fields


def check_topics(station, messages, page):
    """Every panel of the dashboard "mqtt" has data from these messages (topic: payloads) of documented topics."""
    dashboard = load("mqtt")
    for panel in panels(dashboard):
        title, defaults = panel["title"], panel["fieldConfig"]["defaults"]
        for target in panel["targets"]:
            topic = target["topic"]
            assert f"`{topic.replace('$station', 'STATION')}`" in page, f"{title}: {topic} is not documented"
            fields = fields_of(messages[topic.replace("$station", station)])
            fields = transform(fields, panel.get("transformations", []))
            if panel["type"] == "stat":
                shown = panel["options"]["reduceOptions"]["fields"].strip("/")
                fields = {name: values for name, values in fields.items() if re.search(shown, name)}
            else:
                fields = {name: values for name, values in fields.items() if name != "Time"}
            assert fields, f"{title}: no field"
            for name, values in fields.items():
                assert any(value is not None for value in values), f"{title}: no value of {name}"
            for override in panel["fieldConfig"]["overrides"]:
                name = override["matcher"]["options"]
                assert name in fields, f"{title}: {name} is not in {sorted(fields)}"
            mapped = [value for mapping in defaults.get("mappings", []) for value in mapping["options"]]
            received = {value for values in fields.values() for value in values if isinstance(value, str)}
            assert not mapped or received <= set(mapped), f"{title}: no text for {received - set(mapped)}"
    return len(panels(dashboard))


# Panels with data only after a fault.
AFTER_A_FAULT = {"Incidents over time", "Incidents begun"}


def schema(folder):
    names = sorted(path.stem for path in FOLDER.glob("*.json"))
    assert names == ["mqtt", "prometheus"], names
    for name in names:
        check_structure(load(name))
    (pathlib.Path(folder) / "dashboards.ts").write_text(typescript(names))
    count = sum(len(panels(load(name))) for name in names)
    print(f"grafana: {count} panels of {len(names)} dashboards are well-formed")


def query(url, instance, suit_port, simulation):
    dashboard = load("prometheus")
    variables = {"job": "equipoise", "station": "metrics", "instance": instance}
    prometheus = Prometheus(url, variables, interval_s=1)

    def wait(without):
        end = time.monotonic() + PATIENCE_S
        while missing := [panel for panel in prometheus.without_data(dashboard) if panel[0] not in without]:
            assert time.monotonic() < end, f"no data: {json.dumps(missing, indent=1)}"
            time.sleep(1)

    prometheus.wait_until_ready()
    # Datagrams that the adapter refuses.
    with socket.socket(type=socket.SOCK_DGRAM) as sender:
        for _ in range(PATIENCE_S):
            sender.sendto(b"no pose", ("127.0.0.1", int(suit_port)))
            time.sleep(1)
            if prometheus.query({"expr": REFUSED, "instant": True}):
                break
    wait(AFTER_A_FAULT)
    os.kill(int(simulation), signal.SIGTERM)
    wait(set())
    prometheus.check_variables(dashboard)
    queries = [target for panel in panels(dashboard) for target in panel["targets"]]
    samples, count = sum(map(prometheus.query, queries)), len(panels(dashboard))
    print(f"grafana: a Prometheus answers {len(queries)} queries of {count} panels with {samples} samples")


if __name__ == "__main__":
    {"schema": schema, "query": query}[sys.argv[1]](*sys.argv[2:])
