from typing import TYPE_CHECKING

from .faces import load_on_use

if TYPE_CHECKING:
    from . import calibrate as calibrate, sensor as sensor, units as units, version as version
    from .arguments import check_arguments as check_arguments
    from .errors import InputError as InputError
    from .extras import require_extra as require_extra
    from .knowledge import Knowledge as Knowledge
    from .names import (
        ANGLES as ANGLES,
        POSE as POSE,
        STATE_COLUMNS as STATE_COLUMNS,
        STATE_UNITS as STATE_UNITS,
    )
    from .notebook import show_shortly as show_shortly
    from .plain_numbers import short_number as short_number
    from .rigid_body import (
        MIRROR as MIRROR,
        MeasuredObject as MeasuredObject,
        object_displacements as object_displacements,
        rotation_matrix as rotation_matrix,
    )
    from .sensor import Calibration as Calibration, Sensor as Sensor
    from .settings import Config as Config
    from .units import (
        KEY_UNITS as KEY_UNITS,
        Booleans as Booleans,
        Complexes as Complexes,
        Floats as Floats,
        Integers as Integers,
        unit_of as unit_of,
        write_micro as write_micro,
    )
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "arguments": "as_floats check_arguments",
            "channels": "AuxiliaryChannel column_ending",
            "errors": "ConfigError FacetsError InputError",
            "extras": "require_extra",
            "hues": "DARK LIGHT MARKS THEMES chosen_style use_style",
            "keys": "Key block_of item_of key",
            "knowledge": "Knowledge Question",
            "layout": "AmplifierPart LaserPart PsdPart",
            "motions": "Mode Random Runs Sine Steps Sweep Table Vibration",
            "names": (
                "ANGLES FINE_UNITS LABELS POSE READING_COLUMNS STATE STATE_COLUMNS STATE_UNITS"
            ),
            "notebook": "show_shortly",
            "plain_numbers": "short_number",
            "rigid_body": (
                "MIRROR MeasuredObject mirror_poses object_displacements object_poses "
                "rotation_matrix"
            ),
            "sensor": "BenchLight Calibration Sensor Thermal",
            "settings": "Config Solve",
            "units": "Booleans Complexes Floats Integers KEY_UNITS unit_in unit_of write_micro",
        },
    )
