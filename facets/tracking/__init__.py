from ..core.faces import load_on_use

__getattr__ = load_on_use(
    __name__,
    {
        "arrival": "Arrival",
        "check": "SLACK_MM STEP_MM StageCheck checked_today stage_identity",
        "control": "Law Seen margin_of slope_of_error tracking_error",
        "encoder": "Encoder",
        "envelope": "AUTO_RESUME_AFTER_S Envelope",
        "interlock": "BoardPermit ENABLE_S Heartbeat close_line heartbeat_frame open_permit",
        "limits": "Limits",
        "line": "Line",
        "pi": "Pi",
        "priority": "urgent",
        "stage": "StageError StageModel",
        "tracker": "START_WITHIN_S Tracker",
        "zaber": "Zaber checksum",
    },
)
