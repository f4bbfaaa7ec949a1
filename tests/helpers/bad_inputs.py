"""Numbered bad inputs: configurations, tables, arguments and streams with seeded defects.

A case writes its files into a folder and returns a command's words, and whether the input is
certainly bad, so that the command must not end with 0; a random change can leave a good input.
"""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np

import facets
from facets.config import to_yaml
from facets.core import READING_COLUMNS
from facets.files import write_table

STORED = Path(__file__).parents[1] / "stored" / "0.2" / "recording"


def spoil(rng, path):
    """Cut a file, fill it with noise, or change, insert or remove some of its bytes."""
    data, noise = path.read_bytes(), rng.bytes(40)
    place = rng.integers(len(data) + 1)
    begin, end = data[:place], data[place:]
    changes = (begin, noise, begin + noise[:1] + end[1:], begin + noise + end, begin + end[40:])
    path.write_bytes(changes[rng.integers(len(changes))])


#: Pieces of text that are inserted at random places.
PIECES = (
    "\t", ":", "- ", "{", "}", "[", "]", "&x ", "*x", "!", "#", "'", '"', "\n", "  ", "\x00",
    "\x85",
    "é", "<<: *x", "? ", "|", ">", "%YAML 1.1\n", "---\n", "...\n", "extends: paper\n",
    "extends: [paper, rig]\n", "extends: nowhere\n", "sensor: ~\n", "motions: 3\n",
)  # fmt: skip


def insert_piece(rng, text):
    place = rng.integers(len(text))
    return text[:place] + rng.choice(PIECES) + text[place:]


#: Values that no number of a configuration may have.
VALUES = (
    ".nan", ".inf", "-.inf", "1e999", "abc", "'5'", "[1, 2, 3, 4, 5]", "{a: 1}", "true", "~~",
    "2001-13-45", "9" * 5000, "0x", "!!python/object:os.system 1", "*nowhere", "&a [*a]", "1,5",
    "5 mm", "''", "99999999999999999999", "-1e300", "[[[[1]]]]",
)  # fmt: skip
KEYS = ("power", "diameter_mm", "size_m", "extends", "motions", "kind", "ofset", "", "1", "null")


def spoilt_config(rng, folder):
    path, kind = folder / "c.yaml", rng.integers(6)
    lines = to_yaml(facets.load(rng.choice(["paper", "rig", "layout", "bench"]))).splitlines()
    numbered = [n for n, line in enumerate(lines) if ": " in line and any(map(str.isdigit, line))]
    n = rng.choice(numbered)
    key = lines[n].partition(":")[0]
    if kind == 0:
        lines[n] = f"{key}: {rng.choice(VALUES)}"
    elif kind == 1:
        lines.insert(n, lines[n])
    elif kind == 2:
        del lines[n : n + rng.integers(1, 40)]
    elif kind == 3:
        lines[n] = lines[n].replace(key.strip(), rng.choice(KEYS), 1)
    text = "\n".join(lines)
    path.write_text(insert_piece(rng, text) if kind == 4 else text, "utf-8")
    if kind == 5:
        spoil(rng, path)
    return ["config", rng.choice(["check", "show"]), path.name]


def write_readings(path):
    states = np.random.default_rng(1).uniform(-1e-3, 1e-3, (20, 8))
    values = facets.readings(facets.Sensor(), states)
    write_table(path, dict(zip(READING_COLUMNS, values.T, strict=True)), {})


CELLS = ("", "nan", "inf", "-inf", "1e400", "abc", "--", "1,5", '"', "0x10", "1e", "\x00", " ", "٣")


def spoilt_table(rng, folder):
    path = folder / rng.choice(["t.csv", "t.csv", "t.csv.gz", "t.parquet"])
    write_readings(path)
    if path.suffix == ".csv" and rng.random() < 0.7:
        cells = insert_piece(rng, path.read_text("utf-8")).split(",")
        cells[rng.integers(len(cells))] = rng.choice(CELLS)
        path.write_text(",".join(cells), "utf-8")
    else:
        spoil(rng, path)
    beam = rng.choice(["known", "prior", "free"])
    return ["solve", "paper", path.name, "-o", "out.csv", "--beam", beam]


def spoilt_stream(rng, folder):
    shutil.copytree(STORED, folder / "recording")
    path = (
        folder
        / "recording"
        / rng.choice([*sorted(path.name for path in STORED.iterdir()), *3 * ["bytes.bin"]])
    )
    if rng.random() < 0.2:
        path.unlink()
    else:
        spoil(rng, path)
    return ["replay", "recording", "-o", "out.csv", rng.choice(["--compare", "--recover"])]


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
jacobian paper --states 0
jacobian paper --states 100000000000
jacobian paper --states 1e3
jacobian paper -d FILE
jacobian paper --threads -1
explore paper
explore layout --designs 1
explore layout --designs 0
explore layout --objective cost
explore layout -d FILE
explore layout -d LONG
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
    (folder / "DIR" / "thing").touch()
    write_readings(folder / "t.csv")
    words = ARGUMENTS[number % len(ARGUMENTS)].split()
    if rng.random() < 0.3 and len(words) > 1:  # and something that is wrong anywhere
        words.append(rng.choice(["--no-such-option", "--help=1", "-Q", "--force=maybe"]))
    return ["" if word == "''" else word.replace("LONG", "n" * 300) for word in words]


def case(number, folder):
    """Write the files of a case, the same in every run; return its words, and if it is bad."""
    rng = np.random.default_rng([number, 14])
    if number % 4 == 3:
        return bad_arguments(rng, folder, number // 4), True
    return (spoilt_config, spoilt_table, spoilt_stream)[number % 4](rng, folder), False
