from ..core.faces import load_on_use

__getattr__ = load_on_use(
    __name__,
    {
        "arrival": "Arrival MAX_PLACE_AGE_S excursion settling_time",
        "check": "SLACK_MM STEP_MM StageCheck",
        "contract": "check_driver",
        "control": "Law ControlInput capture_range margin_of slope_of_error tracking_error",
        "drivers": "DRIVERS open_driver",
        "encoder": "Encoder",
        "envelope": "Envelope stopping_time",
        "interlock": "BoardPermit ENABLE_S Heartbeat close_line heartbeat_frame open_permit",
        "limits": "Limits",
        "line": "POLL_S",
        "priority": "urgent",
        "stage": "StageError StageModel",
        "tracker": "SolvedSamples Tracker",
        "zaber": "Zaber",
    },
)
