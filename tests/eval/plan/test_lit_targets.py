"""What a plan states of targets in headlamps: settings, their checks, and a run's identity."""

import json
from dataclasses import replace

import pytest
from blurnoise_eval.plan.lamps import Lamps
from blurnoise_eval.plan.lit_targets import LitTargets, road_objects_of
from blurnoise_eval.plan.plan import SweepPlan
from plans import plan

from blurnoise.light.road_objects import RoadObject
from blurnoise.motion.ego import Vehicle

LOW = {"headlamp": "low"}


def test_settings_of_a_file_are_those_of_the_record():
    made = SweepPlan.of(
        {
            **LOW,
            "sheeting": "XI",
            "distance_m": 40,
            "background": "lit",
            "road_objects": {"Speed_Limit": {"width_m": 0.6, "base_m": 2.0, "sheeting": [150, 60, 5]}},
        }
    )
    own = {"speed limit": RoadObject(width_m=0.6, base_m=2.0, sheeting="150,60,5")}
    assert made.lit == LitTargets("XI", own, 40.0, "lit")


def test_a_plan_comes_back_from_its_plain_values():
    made = SweepPlan.of({**LOW, "sheeting": [70, 30, 5], "road_objects": {"sign": {"height_m": 1}}})
    plain = json.loads(json.dumps(made.to_dict()))
    assert SweepPlan.from_dict(plain) == made
    assert json.loads(json.dumps(SweepPlan.from_dict(plain).to_dict())) == plain


def test_plans_without_headlamps_have_the_identity_they_had():
    made = SweepPlan.of({"lux": 10})
    assert not {"lit", "ego"} & made.to_dict().keys()
    assert "headlamp" not in repr(made.conditions()[0])


def test_rendered_signs_stand_where_the_usual_speeds_say_unless_a_plan_says_otherwise():
    assert SweepPlan.of({}).for_rendered().lit.distance_m == 12.5
    assert SweepPlan.of({"distance_m": 40}).for_rendered().lit.distance_m == 40.0
    in_the_dark = SweepPlan.of({"lux": 10})
    assert in_the_dark.for_rendered() == in_the_dark


def test_beams_are_those_of_some_condition():
    assert plan((0.01,), (1.0,)).beams == ()
    assert plan((0.01,), (1.0,), headlamp=("off",)).beams == ()
    assert plan((0.01,), (1.0,), headlamp=("off", "high", "low")).beams == ("low", "high")


def test_beams_of_named_lights():
    assert SweepPlan.of({"light": "street,daylight"}).beams == ("low",)
    assert SweepPlan.of({"light": "street,daylight", "headlamp": "off"}).beams == ()


def test_a_vehicle_carries_headlamps():
    assert SweepPlan.of({**LOW, "vehicle": {"height_m": 1.2}}).vehicle == Vehicle(height_m=1.2)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"headlamp": "hi"}, "headlamp = 'hi': must be one of off, low, high"),
        ({**LOW, "lux": "0,1"}, "headlamp: needs lux > 0; moonlight is 0.3"),
        ({**LOW, "emitters": "targets:10"}, "headlamp, emitters: must not both light the targets"),
        ({"lux": 10, "sheeting": "XI"}, "sheeting: needs headlamp"),
        ({"headlamp": "off", "distance_m": 40.0}, "distance_m: needs headlamp"),
        (
            {**LOW, "sheeting": "IX"},
            "sheeting = 'IX': must be I, III, XI, vest, worn, none, or three numbers",
        ),
        ({**LOW, "background": "grey"}, "background = 'grey': must be one of 'dark', 'lit'"),
        ({**LOW, "distance_m": 0}, "distance_m = 0: must be finite and >= 1"),
        (
            {**LOW, "road_objects": {"speed limit": {"base_m": 2.0}}},
            "road_objects: speed limit: needs width_m or height_m",
        ),
        ({**LOW, "road_objects": {"sign": {"width": 1}}}, "road_objects: sign: field 'width' is unknown"),
        ({**LOW, "road_objects": {"sign": 3}}, "road_objects: sign: must be a mapping of width_m"),
        ({**LOW, "road_objects": [1]}, "must be a mapping of classes"),
        (
            {"lux": 10, "vehicle": {"height_m": 1.2}},
            "vehicle: needs ego_speed_m_s, the speed of the vehicle, or headlamp",
        ),
    ],
    ids=str,
)
def test_faults_are_one_line(settings, message):
    with pytest.raises(ValueError, match=message) as caught:
        SweepPlan.of(settings)
    assert "\n" not in str(caught.value)


def test_pulses_and_headlamps_go_together():
    made = replace(plan((0.01,), (1.0,), headlamp=("low",)), lamps=Lamps(pwm="90,0.5"))
    assert made.beams == ("low",)


def test_own_classes_have_plain_names():
    assert [*road_objects_of({"Number_Plate": {"width_m": 0.3}})] == ["number plate"]
