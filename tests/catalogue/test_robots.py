"""Every robot of the catalogue: closed, heavy, regular at home, the same either way."""

import pytest

from gough import Robot, UnknownName, catalogue, load
from gough.analysis import ranks
from gough.catalogue_facts import compute
from gough.description.values import scalar

NAMES = catalogue.names()
EXPECTED = {
    # name: (mobility, redundant equations, actuation)
    "2rpr": (2, 0, "full"),
    "five-bar": (2, 0, "full"),
    "four-bar": (1, 0, "full"),
    "slider-crank": (1, 0, "full"),
    "3-rpr": (3, 0, "full"),
    "4-rpr": (3, 0, "redundant"),
    "3-rrr": (3, 0, "full"),
    "3-prr": (3, 0, "full"),
    "2rpr-slider": (3, 0, "kinematically redundant"),
    "gough-stewart": (6, 0, "full"),
    "6-sps": (12, 0, "full"),
    "6-ups": (6, 0, "full"),
    "hexaglide": (6, 0, "full"),
    "hexa": (6, 0, "full"),
    "3-rps": (3, 0, "full"),
    "3-upu": (3, 0, "full"),
    "delta": (3, 0, "full"),
    "delta-parallelogram": (3, 6, "full"),
    "linear-delta": (3, 3, "full"),
    "orthoglide": (3, 6, "full"),
    "par4": (4, 4, "full"),
    "agile-eye": (3, 6, "full"),
    "tripteron": (3, 3, "full"),
    "tricept": (3, 0, "full"),
    "bennett": (1, 3, "full"),
    "bricard": (1, 1, "full"),
    "sarrus": (1, 1, "full"),
    "andrews-squeezer": (1, 0, "full"),
    "deployable-hexapod": (6, 0, "full"),
    "biped-leg": (10, 3, "full"),
}


def analysis_of(name, cache={}):  # noqa: B006 the cache is shared on purpose
    if name not in cache:
        cache[name] = load(name).analyse()
    return cache[name]


def test_the_catalogue_is_complete():
    assert set(NAMES) == EXPECTED.keys()


@pytest.mark.parametrize("name", NAMES)
def test_a_robot_closes_at_home(name):
    robot = load(name)
    assembly = robot.home.assembly
    assert assembly.residual < 1e-12 * max(1.0, robot.assembler.length)
    assert (assembly.restarts, assembly.moved) == (0, ())


@pytest.mark.parametrize("name", NAMES)
def test_mobility_redundancy_and_actuation(name):
    analysis = analysis_of(name)
    found = (analysis.mobility, analysis.redundant_equations, analysis.actuation)
    assert found == EXPECTED[name]
    assert sum(item.equations for item in analysis.redundant) == analysis.redundant_equations


@pytest.mark.parametrize("name", NAMES)
def test_home_is_regular_and_its_ranks_are_clear(name):
    analysis = analysis_of(name)
    assert not any(analysis.excess.values())
    assert analysis.singularity.motion is None
    assert analysis.rates.gap > 1e9
    assert analysis.generic.samples >= 6


@pytest.mark.parametrize("name", NAMES)
def test_every_moving_body_has_mass(name):
    massless = name == "deployable-hexapod"  # legs without mass are what its source has
    robot = load(name, variants=("massive-legs",) if massless else ())
    values = robot.models.closure.nominal
    for body in robot.structure.flat.bodies.values():
        assert scalar(body.mass, values) > 0


@pytest.mark.parametrize("name", [name for name in NAMES if load(name).mechanism.platform])
def test_both_ways_of_modelling_agree(name):
    found = []
    for modelling in ("cut-joints", "cut-platform"):
        robot = load(name, modelling)
        rates = ranks.linearise(robot.assembler, robot.home.q)
        defects = ranks.defects(rates.ranks, rates.counts, rates.ranks)
        found.append((ranks.mobility(rates.ranks, rates.counts), defects))
    assert found[0] == found[1]


@pytest.mark.parametrize("name", NAMES)
def test_files_say_what_the_robot_is(name):
    text = catalogue.file(name).read_text("utf-8")
    assert text.startswith("# ")
    assert max(map(len, text.splitlines())) <= 100


def test_stored_facts_are_those_of_today():
    assert catalogue.facts() == [compute(name) for name in NAMES]


def test_the_redundant_equations_of_a_delta_are_named():
    found = {str(item) for item in analysis_of("delta-parallelogram").redundant}
    assert any(text.startswith("leg1.pin4 repeats 1 of its 3 equations") for text in found)


def test_internal_mobility_is_named():
    motions = [motion.description for motion in analysis_of("6-sps").free_motions]
    assert motions[1] == "leg2.cylinder, leg2.rod spin together about their own axis"


def test_a_constraint_singularity_is_named():
    found = load("3-upu", x=0.0, y=0.0, z=1.1).analyse()
    assert found.singularity.constraint
    assert (
        "possible with the outputs at rest: rotation about x of platform"
        in found.singularity.motion
    )
    assert not analysis_of("3-upu").singularity.constraint


def test_names_are_looked_up_with_a_hint():
    with pytest.raises(UnknownName, match="Did you mean 'orthoglide'"):
        load("ortoglide")


def test_loading_twice_gives_equal_robots():
    one, two = load("delta"), load("delta")
    assert one.mechanism == two.mechanism
    assert isinstance(one, Robot)


VARIANTS = [(name, v) for name in NAMES for v in load(name).mechanism.variants]


@pytest.mark.parametrize(("name", "variant"), VARIANTS, ids=map("/".join, VARIANTS))
def test_every_variant_closes_where_it_is_described(name, variant):
    robot = load(name, variants=variant)
    assert not robot.home.assembly.moved
    assert robot.mechanism.variants[variant].about
    assert robot.mechanism != load(name).mechanism or variant == "universal-radial"
