from typing import TYPE_CHECKING

from ..core.faces import load_on_use

if TYPE_CHECKING:
    from . import budget as budget
    from . import identifiability as identifiability
    from . import proposal as proposal
    from . import reference_join as reference_join
    from . import rezero as rezero
    from . import table as table
    from . import tour as tour
    from . import unknowns as unknowns
    from . import verdict as verdict
else:
    __getattr__ = load_on_use(
        __name__,
        {
            "bundle_adjustment": (
                "Data OWN_COUNT OWN_UNITS eliminate_own_unknowns "
                "linearise_model own_sigma predict_readings states_of"
            ),
            "fit": "GAINS LOWER_BOUNDS_MM Task prior_information",
            "laser": "fit_steady_laser",
            "identifiability": (
                "choose_poses information mean_reduction pose_information weak_directions"
            ),
            "reference_join": "join_tables",
            "rezero": (
                "CHANGES ChangePriors LEAST_CHANCE StopReadings average_stop renew_zero "
                "stop_readings"
            ),
            "samples": "add_converter_steps",
            "table": (
                "REFERENCE choice choose_groups gather_samples read recording_time velocities"
            ),
            "tour": "short_order travel",
            "unknowns": "ALL Choice PLACE assign_values block fold_mount values_of",
        },
    )
