"""A closed loop says how far it is, and of a lost one which trial is made."""

from femfit.simulation.close_loop import close_loop


def told(model, **options):
    parts = []
    close_loop(model, runs=1, targets_m=(0.022,), progress=lambda *part: parts.append(part), **options)
    return parts


def test_a_loop_counts_its_samples_up_to_the_last(levitation_model):
    parts = told(levitation_model, controller="pid", seconds=0.1)
    names, done, total = zip(*parts, strict=True)
    assert set(names) == {"closed loop"}
    assert len(set(total)) == 1
    assert list(done) == sorted(set(done))
    assert total[0] - 50 <= done[-1] < total[0]  # it reports at every 50th sample


def test_the_trials_of_a_lost_loop_are_told_apart(levitation_model):
    names = [name for name, *_ in told(levitation_model, controller="pid", gains={"kp": 1.0, "kd": 0.0}, seconds=1.0)]
    assert names[0] == "closed loop"
    assert any("trial 1" in name for name in names)
