"""The messages of a publication by ZeroMQ.

A message with samples has three parts: the topic `samples`, a header in JSON, and the rows as they
are in memory. The header has the number of the first row, the number of rows, the dtype and the
units of the columns. A subscriber for which `HIGH_WATER_MARK` messages wait misses later ones, and
the others do not. It derives the number of missed rows from the number of the first row, and
reports it to the publisher (`lost N`), which counts them. Each new subscriber first gets the
description of the samples, after the topic `about`. docs/formats.md describes the messages for
other languages.

The processes that a run starts also subscribe to the topics `status`, the state of the run for its
page, and `end`, which is the last message. Their replies begin with `from` and their token, which
nobody else knows.
"""

from __future__ import annotations

SAMPLES, STATUS, END = b"samples", b"status", b"end"
ABOUT, LOST, FROM = b"about", b"lost ", b"from "
#: Maximum number of messages that wait for one subscriber, at each end: 250,000 samples at 50 kHz.
HIGH_WATER_MARK = 1_000
#: The same of a replay, whose messages are larger and which waits, and in the processes of a run.
SHORT_HIGH_WATER_MARK = 100
#: Messages that wait at the end of a program are still sent for up to this time, ms.
LINGER_MS = 2_000
#: Interval of the reports between a run and its processes, s.
REPORT_INTERVAL_S = 0.25
#: A process of a run that has not begun within this time is ended, s.
START_TIMEOUT_S = 60.0
