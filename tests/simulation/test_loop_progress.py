"""A closed loop says how far it is, and of a lost one what is tried."""

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
    names = [name for name, *_ in told(levitation_model, controller="pid", stuck_after_s=0.05, seconds=0.4)]
    assert names[0] == "closed loop"
    tried = set(names[1:]) - {"closed loop"}
    assert len(tried) > 1
    assert all(name.startswith("why runs are lost") for name in tried)
