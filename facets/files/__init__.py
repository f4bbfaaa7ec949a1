from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import provenance as provenance
    from . import tables as tables
    from . import whole as whole
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "provenance": "provenance_header run_record",
            "tables": "read_chunks read_head write_table",
            "whole": "ResultSet Whole readable_path remove_older",
        },
    )
