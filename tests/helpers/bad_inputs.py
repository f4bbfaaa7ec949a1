"""Numbered bad inputs: configurations, tables, arguments and streams with seeded defects.

A case writes its files into a folder and returns a command's words. `certain` says that the input
is certainly bad, so that the command must not end with 0; a random change can leave a good input.
"""

from __future__ import annotations

import shutil
import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from facets.experiments import kills

import facets
from facets.config import to_yaml
from facets.core import READING_COLUMNS
from facets.files import run_record
from facets.live import Block, Recording


@dataclass(frozen=True)
class Case:
    words: list[str]
    certain: bool
    what: str


# --- configurations -----------------------------------------------------------------------------

#: Values that no number of a configuration may have.
VALUES = (
    ".nan", ".inf", "-.inf", "1e999", "abc", "'5'", "[1, 2, 3, 4, 5]", "{a: 1}", "true", "~~",
    "2001-13-45", "9" * 5000, "0x", "!!python/object:os.system 1", "*nowhere", "&a [*a]", "1,5",
    "5 mm", "''", "99999999999999999999", "-1e300", "[[[[1]]]]",
)  # fmt: skip
#: Pieces of text that are inserted at random places.
PIECES = (
    "\t", ":", "- ", "{", "}", "[", "]", "&x ", "*x", "!", "#", "'", '"', "\n", "  ", "\x00",
    "\x85",
    "é", "<<: *x", "? ", "|", ">", "%YAML 1.1\n", "---\n", "...\n", "extends: paper\n",
    "extends: [paper, rig]\n", "extends: nowhere\n", "sensor: ~\n", "motions: 3\n",
)  # fmt: skip
KEYS = ("power", "diameter_mm", "size_m", "extends", "motions", "kind", "ofset", "", "1", "null")


def spoilt_config(rng, folder):
    text = to_yaml(facets.load(rng.choice(["paper", "rig", "layout", "bench"])))
    lines = text.splitlines()
    kind = rng.integers(8)
    numbered = [n for n, line in enumerate(lines) if ": " in line and any(map(str.isdigit, line))]
    n = rng.choice(numbered)
    key = lines[n].partition(":")[0]
    certain = False
    if kind == 0:
        lines[n] = f"{key}: {rng.choice(VALUES)}"
    elif kind == 1:
        place = rng.integers(len(text))
        lines = (text[:place] + rng.choice(PIECES) + text[place:]).splitlines()
    elif kind == 2:
        lines.insert(n, lines[n])
    elif kind == 3:
        del lines[n : n + rng.integers(1, 40)]
    elif kind == 4:
        lines[n] = lines[n].replace(key.strip(), rng.choice(KEYS), 1)
    elif kind == 5:
        raw = bytearray(text.encode())
        for place in rng.integers(len(raw), size=5):
            raw[place] = rng.integers(256)
        (folder / "c.yaml").write_bytes(raw)
    elif kind == 6:
        multiply(folder / "c.yaml", rng.integers(5, 30))
        certain = True
    else:
        chain(folder, rng.integers(5, 120))
    if kind < 5:
        (folder / "c.yaml").write_text("\n".join(lines), "utf-8")
    word = ["config", rng.choice(["check", "show"]), "c.yaml"]
    if rng.random() < 0.2:
        word = ["simulate", "c.yaml", "--motion", "nowhere", "-d", "out"]
        certain = True
    return Case(word, certain, f"configuration, way {kind}")


def multiply(path, depth):
    """Write aliases of aliases, which give 10^depth values in `depth` lines."""
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, depth)]
    path.write_text("\n".join(lines))


def chain(folder, depth):
    """Write files that each extend the previous one twice: 2^depth readings of the first."""
    (folder / "0.yaml").write_text("extends: paper\n")
    for n in range(1, depth):
        (folder / f"{n}.yaml").write_text(f"extends: [{n - 1}.yaml, {n - 1}.yaml]\n")
    (folder / "c.yaml").write_text(f"extends: {depth - 1}.yaml\n")


# --- tables -------------------------------------------------------------------------------------


def readings(rows, seed):
    rng = np.random.default_rng(seed)
    states = rng.uniform(-0.02, 0.02, (rows, 8)) * [1, 1, 1, 0.1, 0.1, 0.1, 1, 1]
    values = facets.readings(facets.Sensor(), states)
    table = dict(zip(READING_COLUMNS, values.T, strict=True))
    return {"time_s": 1e-3 * np.arange(rows), **table}


def csv_text(table, mark=","):
    rows = zip(*table.values(), strict=True)
    return "\n".join(mark.join(map(str, row)) for row in (table, *rows)) + "\n"


CELLS = ("", "nan", "inf", "-inf", "1e400", "abc", "--", "1,5", '"', "0x10", "1e", "\x00", " ", "٣")


def spoilt_table(rng, folder):
    table = readings(rng.integers(1, 30), rng.integers(1000))
    path, kind, certain = folder / "t.csv", rng.integers(14), True
    name = rng.choice(list(READING_COLUMNS))
    text = csv_text(table)
    if kind == 0:
        table.pop(name)
        path.write_text(csv_text(table))
    elif kind == 1:
        path.write_text(text.replace(name, name[:-2]))
    elif kind == 2:
        path.write_bytes(text.encode("utf-16"))
    elif kind == 3:
        path.write_text(text.partition("\n")[0] + "\n" * int(rng.integers(3)))
    elif kind == 4:
        path.mkdir()
    elif kind == 5:
        path.write_bytes(rng.bytes(rng.integers(5000)))
    elif kind == 6:
        as_parquet(rng, path, table, name)
    elif kind == 7:
        path = folder / "t.parquet"
        certain = as_parquet(rng, path, table, name)
    elif kind == 8:
        clock = [f"12:00:{n:02}" for n in range(len(table["time_s"]))]
        path.write_text(csv_text(table | {"time_s": clock}))
    elif kind == 9:
        path.write_text(f"{text.partition(chr(10))[0]},{name}\n")
    else:
        certain = False
        path.write_text(spoilt_cells(rng, table, kind))
    words = ["solve", "paper", path.name, "-o", "out.csv"]
    if rng.random() < 0.3:
        words += ["--beam", rng.choice(["known", "prior", "free"])]
    if rng.random() < 0.25:
        words = ["calibrate", "paper", path.name, "-o", "out.yaml"]
        certain = True  # without a reference
    return Case(words, certain, f"table, way {kind}")


def spoilt_cells(rng, table, kind):
    text = csv_text(table, "\t" if kind == 12 else ",")
    if kind in (10, 12):
        lines = text.splitlines()
        for _ in range(rng.integers(1, 10)):
            n = rng.integers(len(lines))
            cells = lines[n].split(",")
            cells[rng.integers(len(cells))] = rng.choice(CELLS)
            lines[n] = ",".join(cells)
        return "\n".join(lines)
    if kind == 11:
        return text[: rng.integers(len(text))]
    place = rng.integers(len(text))
    return text[:place] + str(rng.choice(PIECES)) * int(rng.integers(1, 200)) + text[place:]


def as_parquet(rng, path, table, name):
    """Write Parquet with a bad column or cut off; return whether it is certainly bad."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = {key: pa.array(values) for key, values in table.items()}
    kind = rng.integers(5)
    count = len(columns[name])
    if kind == 0:
        columns[name] = pa.array([[1.0, 2.0]] * count)
    elif kind == 1:
        columns["time_s"] = pa.array(np.arange(count).astype("datetime64[s]"))
    elif kind == 2:
        columns[name] = pa.array(["1.0"] * count)
    elif kind == 3:
        columns[name] = pa.array([None] * count, pa.float64())
    pq.write_table(pa.table(columns), path)
    if kind == 4:
        raw = path.read_bytes()
        path.write_bytes(raw[: rng.integers(len(raw))])
    return kind < 3 or kind == 4


# --- arguments ----------------------------------------------------------------------------------

#: Each is refused, or finds nothing, in every case. FILE is a file, DIR a folder with something in.
ARGUMENTS = """\
simulate
simulate nowhere
simulate paper --motion jump
simulate paper --seed -1
simulate paper -d FILE
simulate paper -d FILE/x
simulate paper -d LONG
simulate paper --table xls
simulate paper --plot bmp
simulate paper extra
simulate DIR
simulate FILE
simulate ''
solve
solve paper
solve paper none.csv
solve paper none.csv -o out.csv
solve paper DIR -o out.csv
solve paper FILE -o out.csv
solve paper t.csv -o DIR
solve paper t.csv -o out.txt
solve paper t.csv -o FILE/out.csv
solve paper t.csv -o t.csv --force
solve paper t.csv -o LONG.csv
solve paper t.csv -o out.csv --beam fixed
solve paper t.csv -o out.csv --method newton
solve paper t.csv -o out.csv --method paper --beam known
range-map paper --axes tx
range-map paper --axes tx,tx
range-map paper --axes tx,up
range-map paper --at tz_mm=high
range-map paper --at tz_mm=nan
range-map paper --at =
range-map paper --at tx_mm=3
range-map paper --at tz_mm=1e300
range-map paper --grid -1
range-map paper -d FILE
range-map paper -d LONG
range-map paper --inside up
resolution nowhere
resolution paper -d FILE
resolution paper --plot x
jacobian paper --box tx_mm=1e6
jacobian paper --box tx_mm=nan
jacobian paper --box x=1
jacobian paper --box tx_mm=-1
jacobian paper --box tx_mm=5:1
jacobian paper --box ''
jacobian paper --box tx_mm=1:2:3
jacobian paper --left-out phi
jacobian paper --states 0
jacobian paper --states 100000000000
jacobian paper --states 1e3
jacobian paper -d FILE
jacobian paper --limit 0
jacobian paper --threads -1
explore paper
explore layout --designs 1
explore layout --designs 0
explore layout --objective cost
explore layout -d FILE
explore layout -d LONG
explore layout --sampling random
explore layout --scheduler tcp://127.0.0.1:1 -d out
optimize layout -o out.txt
optimize layout -o FILE/out.yaml
optimize layout -o LONG.yaml
optimize nowhere
optimize layout --plot x
render paper -o out.bmp
render paper -o out.mp4
render paper --at tx_mm=x
render paper --motion jump -o out.mp4
render paper --width 5
render paper --frames 1
render paper --spots --plan
render paper --spots -o out.gltf
render paper -o FILE/x.png
render paper --recording none -o out.mp4
render paper --view top
render paper -o LONG.png
calibrate paper
calibrate paper none.csv
calibrate paper t.csv -o out.txt
calibrate paper DIR -o out.yaml
calibrate paper t.csv -o out.yaml
calibrate nowhere t.csv
replay none
replay FILE
replay DIR
recover none
replay FILE --recover
replay DIR --recover
reproduce nothing
reproduce table1 -d FILE
reproduce table1 -d LONG
bench -d FILE
bench --seed -1
config check nowhere
config check DIR
config check
config check FILE paper
config show
config show nowhere
config show FILE
config x
nothing
--nothing
simulate --track paper -x
config schema x
emulate nowhere
emulate bench --motion jump
acquire nowhere
""".splitlines()


def bad_arguments(rng, folder, number):
    (folder / "FILE").write_text("nothing\n")
    (folder / "DIR").mkdir()
    (folder / "DIR" / "thing").write_text("")
    (folder / "t.csv").write_text(csv_text(readings(5, 1)))
    words = ARGUMENTS[number % len(ARGUMENTS)].split()
    words = ["" if word == "''" else word.replace("LONG", "n" * 300) for word in words]
    if rng.random() < 0.3 and len(words) > 1:  # and something that is wrong anywhere
        words.append(rng.choice(["--no-such-option", "--help=1", "-Q", "--force=maybe"]))
    return Case(words, True, "arguments")


# --- streams ------------------------------------------------------------------------------------


@cache
def make_recording():
    """A recording of some samples."""
    place = Path(tempfile.mkdtemp()) / "recording"
    config = facets.load("bench")
    recording = Recording(place, run_record(config, None, 0.0, {}), config.resolved)
    data = kills.stream(60)
    for n in range(0, len(data), 640):
        recording.add_block(Block(data[n : n + 640], n * 1e-6, None))
    recording.close()
    return place


def recorded(folder):
    """Copy a recording of some samples."""
    return shutil.copytree(make_recording(), folder / "recording")


def spoilt_stream(rng, folder):
    recording = recorded(folder)
    files = sorted(file for file in recording.iterdir() if file.is_file())
    weights = np.array([6.0 if file.name == "bytes.bin" else 1.0 for file in files])
    file = files[rng.choice(len(files), p=weights / weights.sum())]
    data, kind = file.read_bytes(), rng.integers(6)
    place = rng.integers(len(data) + 1)
    if kind == 0:
        file.unlink()
    elif kind == 1:
        file.write_bytes(data[:place])
    elif kind == 2:
        file.write_bytes(rng.bytes(rng.integers(3000)))
    elif kind == 3 and data:
        raw = bytearray(data)
        for n in rng.integers(len(raw), size=rng.integers(1, 40)):
            raw[n] ^= 1 << rng.integers(8)
        file.write_bytes(raw)
    elif kind == 4:
        file.write_bytes(data[:place] + rng.bytes(rng.integers(100)) + data[place:])
    else:
        file.write_bytes(data[:place] + data[place + rng.integers(200) :])
    words = ["replay", "recording", "-o", "out.csv", *([[], ["--recover"]][rng.integers(2)])]
    return Case(words, False, f"stream, {file.name}, way {kind}")


def case(number, folder):
    """Return the case of a number, the same in every run, and write its files into the folder."""
    rng = np.random.default_rng([number, 14])
    if number % 4 == 3:
        return bad_arguments(rng, folder, number // 4)
    return (spoilt_config, spoilt_table, spoilt_stream)[number % 4](rng, folder)
