"""An outlet of liblsl itself: a plate of six channels at 1 kHz, until it is ended. lsl.py FORMAT"""

import sys
import time

import pylsl

FORMATS = {
    "float32": pylsl.cf_float32,
    "double64": pylsl.cf_double64,
    "int8": pylsl.cf_int8,
    "int16": pylsl.cf_int16,
    "int32": pylsl.cf_int32,
    "int64": pylsl.cf_int64,
}
CHANNELS = [("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "Nmm"), ("My", "Nmm"), ("Mz", "Nmm")]

name = sys.argv[1]
info = pylsl.StreamInfo("Plate", "Force", len(CHANNELS), 1000, FORMATS[name], f"plate-{name}")
channels = info.desc().append_child("channels")
for label, unit in CHANNELS:
    channels.append_child("channel").append_child_value("label", label).append_child_value("unit", unit)
outlet = pylsl.StreamOutlet(info)
print("ready", flush=True)
sent = 0
while True:
    # Chunks, so that samples without a stamp of their own come, too.
    chunk = [[(sent + index) % 100, -2, 120, 4, -5, 6] for index in range(100)]
    outlet.push_chunk(chunk)
    sent += len(chunk)
    time.sleep(0.1)
