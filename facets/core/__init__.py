from typing import TYPE_CHECKING

from .faces import load_on_use

if TYPE_CHECKING:
    from . import calibrate as calibrate
    from . import sensor as sensor
    from . import units as units
    from . import version as version
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "arguments": "as_floats",
            "channels": "AuxiliaryChannel column_ending",
            "errors": "ConfigError FacetsError InputError",
            "hues": "DARK LIGHT MARKS THEMES chosen_style use_style",
            "keys": "Key block_of item_of key",
            "knowledge": "Knowledge Question",
            "layout": "AmplifierPart LaserPart PsdPart",
            "motions": "Mode Random Runs Sine Steps Sweep Table Vibration",
            "names": "ANGLES FINE_UNITS LABELS READING_COLUMNS STATE STATE_COLUMNS STATE_UNITS",
            "plain_numbers": "short_number",
            "rigid_body": "MeasuredObject mirror_poses object_displacements object_poses",
            "sensor": "BenchLight Calibration Thermal",
            "settings": "Solve",
            "units": "Floats KEY_UNITS unit_in",
        },
    )
