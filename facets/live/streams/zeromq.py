"""The messages of a publication by ZeroMQ.

A message with samples has three parts: the topic `samples`; a header in JSON, with the number of
the first row, the number of rows, the dtype and the units of the columns; and the rows as they are
in memory. A subscriber for which `HIGH_WATER_MARK` messages wait misses what comes then, and the
others do not. It sees from the number of the first row how many rows it has missed, and tells the
publisher (`lost N`), which counts them. Each new subscriber first gets the description of the
samples, after the topic `about`. docs/formats.md describes the messages for other languages.

The processes that a run starts also take the topics `status`, what the run says of itself for its
page, and `end`, after which nothing follows. What they say begins with `from` and their token,
which nobody else knows.
"""

from __future__ import annotations

SAMPLES, STATUS, END = b"samples", b"status", b"end"
ABOUT, LOST, FROM = b"about", b"lost ", b"from "
#: Maximum number of messages that wait for one subscriber, at each end: 250,000 samples at 50 kHz.
HIGH_WATER_MARK = 1_000
#: The same of a replay, whose messages are larger and which waits, and in the processes of a run.
SHORT_HIGH_WATER_MARK = 100
#: What waits at the end of a program is still sent for up to this time, ms.
LINGER_MS = 2_000
#: A run and its processes tell each other of themselves this often, s.
REPORT_INTERVAL_S = 0.25
#: A process of a run that has not begun within this time is ended, s.
START_TIMEOUT_S = 60.0
