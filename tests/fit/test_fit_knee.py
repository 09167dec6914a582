"""A knee between currents that are not evenly spaced."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import fixed_quad

import femfit as ff

DISTANCES_M, CURRENTS_A = np.array([0.15, 0.225, 0.3, 0.6, 1.0, 1.5, 2.0]) * 1e-3, [0.0, 0.25, 0.5, 0.75, 1.0, 1.5]


def knee(distance, current, saturated_Wb, sharpness, reluctance_m):
    """Flux linkage x / (1 + (x / s)^n)^(1/n) + L_0 i with x = c i / (d + 0.1 mm): n says how sharp the knee is."""
    x = reluctance_m / (distance + 1e-4) * current
    return x / (1.0 + (x / saturated_Wb) ** sharpness) ** (1.0 / sharpness) + 2e-3 * current


@pytest.mark.parametrize(
    ("saturated_Wb", "sharpness", "reluctance_m"), [(0.02, 12, 5e-5), (0.02, 30, 2e-5), (0.04, 6, 5e-5)]
)
def test_an_inductance_is_positive_between_currents_about_a_sharp_knee(tmp_path, saturated_Wb, sharpness, reluctance_m):
    device = saturated_Wb, sharpness, reluctance_m
    d, i = (x.ravel() for x in np.meshgrid(DISTANCES_M, CURRENTS_A, indexing="ij"))

    def coenergy(distance):
        return fixed_quad(lambda s: knee(distance[:, None], np.outer(i, s), *device), 0.0, 1.0, n=400)[0] * i

    least = np.maximum(i - 1e-6, 0.0)
    rise = knee(d, i + 1e-6, *device) - knee(d, least, *device)
    columns = {"current_A": i, "distance_m": d, "force_N": (coenergy(d - 1e-8) - coenergy(d + 1e-8)) / 2e-8}
    columns |= {"flux_linkage_Wb": knee(d, i, *device), "inductance_H": rise / (i + 1e-6 - least)}
    pd.DataFrame(columns).to_csv(tmp_path / "knee.csv", index=False)
    # So coarse a grid does not show to which co-energy a knee's force and flux linkage belong
    model = ff.fit_model(ff.import_table(tmp_path / "knee.csv", accept=("reciprocity",))).model
    assert model.magnetics.inductance(*model.validity.grid(101, 101)).min() > 0.0
