"""State estimators: UKF, square-root UKF, EKF. numpy only."""
