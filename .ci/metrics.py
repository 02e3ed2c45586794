"""Scrapes a running daemon twice and evaluates what it finds: metrics.py URL FILE-FOR-THE-PLAIN-TEXT."""

import sys
import time
import urllib.request

from prometheus_client.openmetrics.parser import text_string_to_metric_families as open_metrics
from prometheus_client.parser import text_string_to_metric_families as plain

# Family (as the plain parser names it) and type.
EXPECTED = {
    "equipoise_build_info": "gauge",
    "equipoise_cycles": "counter",
    "equipoise_slots_skipped": "counter",
    "equipoise_deadlines_missed": "counter",
    "equipoise_input_samples_dropped": "counter",
    "equipoise_input_samples_refused": "counter",
    "equipoise_output_states_dropped": "counter",
    "equipoise_adapter_received": "counter",
    "equipoise_adapter_samples_published": "counter",
    "equipoise_adapter_refused": "counter",
    "equipoise_adapter_rate_hertz": "gauge",
    "equipoise_incidents": "counter",
    "equipoise_incident_active": "gauge",
    "equipoise_publishing": "gauge",
    "equipoise_sample_age_seconds": "gauge",
    "equipoise_phase": "gauge",
    "equipoise_poses_used": "gauge",
    "equipoise_joint_level_cycles": "counter",
}


def scrape(url, accept):
    request = urllib.request.Request(url, headers={"Accept": accept})
    with urllib.request.urlopen(request, timeout=10) as answer:
        return answer.headers["Content-Type"], answer.read().decode()


def families(text, parser):
    found = {}
    for family in parser(text):
        assert family.name not in found, f"{family.name} twice"
        assert family.documentation, f"{family.name} has no help"
        found[family.name] = family
    return found


def samples(family):
    seen = {(sample.name, tuple(sorted(sample.labels.items()))): sample.value for sample in family.samples}
    assert len(seen) == len(family.samples), f"{family.name}: the same labels twice"
    return seen


def until_complete(url):
    for _ in range(300):
        try:
            kind, text = scrape(url, "text/plain")
            found = families(text, plain)
            if not EXPECTED.keys() - found.keys():
                return kind, text, found
            missing = EXPECTED.keys() - found.keys()
        except OSError as error:
            missing = error
        time.sleep(0.1)
    raise SystemExit(f"metrics: waited in vain for {missing}")


def main():
    url, path = sys.argv[1:]
    kind, text, first = until_complete(url)
    assert kind.startswith("text/plain; version=0.0.4"), kind
    for name, type_ in EXPECTED.items():
        assert first[name].type == type_, f"{name} is a {first[name].type}"
    for family in first.values():
        assert family.type in ("counter", "gauge"), f"{family.name} is {family.type}"
        for sample in family.samples:
            assert sample.labels["station"] == "metrics", sample
            assert sample.value >= 0, sample
            assert family.type != "counter" or sample.name.endswith("_total"), sample
    assert sum(sample.value for sample in first["equipoise_phase"].samples) == 1
    time.sleep(1)
    kind, newer = scrape(url, "application/openmetrics-text; version=1.0.0")
    assert kind.startswith("application/openmetrics-text"), kind
    second = families(newer, open_metrics)
    grown = 0
    for name, family in first.items():
        if family.type != "counter":
            continue
        later = samples(second[name])
        for key, value in samples(family).items():
            assert later[key] >= value, f"{key} fell from {value} to {later[key]}"
            grown += later[key] > value
    cycles = list(samples(second["equipoise_cycles"]).values())[0] - list(samples(first["equipoise_cycles"]).values())[0]
    assert cycles > 0 and grown > 3, (cycles, grown)
    with open(path, "w") as file:
        file.write(text)
    print(f"metrics: {len(first)} families, {sum(len(f.samples) for f in first.values())} samples, both formats understood;"
          f" {cycles:.0f} cycles and {grown} counts grew")


main()
