from ..core.faces import load_on_use

__getattr__ = load_on_use(
    __name__,
    {
        "arrival": "Arrival MAX_PLACE_AGE_S excursion settling_time",
        "check": "SLACK_MM STEP_MM StageCheck checked_today stage_identity",
        "contract": "check_driver",
        "control": "Law Seen margin_of pull_of slope_of_error tracking_error",
        "drivers": "open_driver",
        "encoder": "Encoder",
        "envelope": "AUTO_RESUME_AFTER_S Envelope stopping_time",
        "interlock": "BoardPermit ENABLE_S Heartbeat close_line heartbeat_frame open_permit",
        "limits": "Limits",
        "line": "Line POLL_S",
        "pi": "Pi",
        "priority": "urgent",
        "stage": "StageError StageModel",
        "tracker": "START_WITHIN_S Tracker",
        "zaber": "Zaber checksum",
    },
)
