"""What the verdict says agrees with the numbers of its own table."""

from dataclasses import replace

import pytest

from femfit.effects.catalogue import effect_by_name
from femfit.effects.effect import AddedEffect
from femfit.identify.comparison.misfit import ChannelFall, ErrorFall
from femfit.identify.decision.diagnose import diagnose
from femfit.identify.decision.diagnosis_text import verdict_sentence
from support.campaign import campaign


@pytest.fixture(scope="module")
def found(levitation_model):
    warm = AddedEffect(effect_by_name("current_gain"), {"gain_error": 0.05})
    return diagnose(levitation_model, campaign(levitation_model, 7, [warm]), bootstrap=0)


@pytest.mark.parametrize(("times", "readings", "said"), [(1.76, 121, True), (1.1, 121, False), (1.4, 4, True)])
def test_an_error_that_is_left_beyond_the_noise_is_said_in_the_verdict(found, times, readings, said):
    sigma = found.campaign.noise.floor["voltage_V"]
    left = ChannelFall("voltage_V", readings, 3.0, times * sigma, sigma)
    campaign_without_mounts = replace(
        found.campaign,
        whitening=replace(found.campaign.whitening, noise=replace(found.campaign.noise, mount_m=0.0)),
    )
    one = replace(found, verdict="named", error_fall=ErrorFall((left,)), campaign=campaign_without_mounts)
    assert (f"{times:.3g} times" in verdict_sentence(one)) is said


def test_what_was_found_is_not_said_to_show_from_another_size(found):
    assert found.missing
    listed = str(found).split("nine times in ten:")[1]
    assert not any(f"  {one.name} from:" in listed for one in found.missing)


def test_what_changes_no_reading_is_said_where_nothing_is_named(found):
    blind = found.ranking[-1].name
    scores = (*found.ranking[:-1], replace(found.ranking[-1], note="it changes no reading at these settings"))
    lines = str(replace(found, missing=(), verdict="nothing_missing", ranking=scores)).splitlines()
    assert blind in lines[1]
