"""Calls the exported solver from Python without facets: make library, then run this file."""

import ctypes
import pathlib
import sys

folder = pathlib.Path(__file__).resolve().parent.parent
code = ctypes.CDLL(str(folder / (sys.argv[1] if len(sys.argv) > 1 else "libfacets.so")))
Real = ctypes.c_double if code.facets_real_size() == 8 else ctypes.c_float
code.facets_status_text.restype = ctypes.c_char_p

state = (Real * 8)(0, 0, 0.1, 0, 0, 0.001, 0, 0)  # mm, rad
reading = (Real * 9)()
code.facets_readings(state, reading)
print("reading:", [round(x, 6) for x in reading])

numbers = (Real * 77)()
status = code.facets_solve_plain(reading, None, 0, numbers)
print("status:", code.facets_status_text(status).decode())
print("tz:", round(numbers[2], 6), "mm; yaw:", round(1e3 * numbers[5], 6), "mrad")
