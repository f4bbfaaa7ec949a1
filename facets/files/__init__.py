from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import crate as crate, provenance as provenance, tables as tables, whole as whole
    from .columns import (
        TIMES as TIMES,
        join_columns as join_columns,
        row_times as row_times,
        unit_of_column as unit_of_column,
    )
    from .crate import write_crate as write_crate
    from .frame_table import FrameTable as FrameTable, make_frame as make_frame
    from .tables import Source as Source, read_chunks as read_chunks, read_words as read_words
    from .whole import Whole as Whole
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "columns": "TIMES join_columns row_times unit_of_column",
            "crate": "write_crate",
            "frame_table": "FrameTable make_frame",
            "provenance": "provenance_header run_record",
            "tables": "Source read_chunks read_head read_words write_table",
            "whole": "ResultSet Whole readable_path remove_older",
        },
    )
