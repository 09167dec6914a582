"""State estimators: UKF, square-root UKF, EKF; in ``integrate`` flux and field from a coil's voltage. numpy only."""
