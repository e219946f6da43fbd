"""The verified cases of robots in the literature: mobility, defects, and what printed tests say.

Columns: equations n, mobility m, the five defects, redundant equations, and conditions (5), (8),
(9), (10) of Lahouar, Zeghloul and Romdhane (2007) as printed there, of which none is a test of
singularity by itself.
"""

from math import pi, sqrt

from gough import Mechanism, Robot, load

D4 = 0.31058  # length of the Orthoglide's parallelograms, m
CASES = [
    ("2RPR regular", "2rpr", {}),
    ("2RPR legs aligned", "2rpr", {"y": 0}),
    ("2RPR leg length zero", "2rpr", {"x": 0, "y": 0}),
    ("3-RPR regular", "3-rpr", {}),
    ("3-RRR regular", "3-rrr", {}),
    ("3-RPR leg lines concurrent", "3-rpr", {"theta": 0.038112418178676374}),
    (
        "3-RRR one leg stretched",
        "3-rrr",
        {
            "x": 1.0468369477963466,
            "y": 0.3952196253530994,
            "q": [0.3, 1.8854893243705584, 0.22648219804933112],
        },
    ),
    ("3-RRR distal links concurrent", "3-rrr", {"theta": -0.7766776117794119}),
    ("3-RPR, third leg passive", "3-rpr without its third motor", {}),
    ("4-RPR planar", "4-rpr", {}),
    ("2RPR + active base slider", "2rpr-slider", {}),
    ("5-bar with d = 2 l1, flat", "five-bar", {"d": 1.2, "x": 1.3, "y": 0, "q": [0, pi]}),
    ("6-UPS regular", "gough-stewart", {}),
    ("6-UPS platform yaw 90°", "gough-stewart", {"x": 0, "y": 0, "rx": 0, "ry": 0, "rz": pi / 2}),
    ("6-SPS method 1", "6-sps", {}),
    ("6-SPS method 2", "6-sps", {"modelling": "cut-platform"}),
    ("Delta, six S-S bars", "delta", {}),
    ("Delta, 4R parallelograms", "delta-parallelogram", {}),
    ("Orthoglide, 4R parallelograms", "orthoglide", {}),
    (
        "Orthoglide legs coplanar",
        "orthoglide",
        {"x": -D4 / sqrt(6), "y": -D4 / sqrt(6), "z": 0.6 - D4 / sqrt(6)},
    ),
    (
        "Orthoglide legs parallel",
        "orthoglide",
        {"x": D4 / sqrt(3), "y": D4 / sqrt(3), "z": 0.6 + D4 / sqrt(3)},
    ),
    ("3-UPU translational, regular", "3-upu", {}),
    ("3-UPU centred", "3-upu", {"x": 0, "y": 0}),
    (
        "4-bar parallelogram, flat",
        "four-bar",
        {"a": 0.4, "b": 1, "c": 0.4, "d": 1, "angle": 0, "coupler": 0, "rocker": 0},
    ),
]


def robot_of(name: str, settings: dict) -> Robot:
    if not name.endswith("without its third motor"):
        return load(name, **settings)
    mechanism = load("3-rpr").mechanism.written_out()
    slide = mechanism.joints["leg3.slide"].model_copy(update={"actuated": False})
    joints = {**mechanism.joints, "leg3.slide": slide}
    return Robot(Mechanism(**{**dict(mechanism), "joints": joints}))


def row(label: str, robot: Robot) -> str:
    found = robot.analyse()
    d, tests = found.defects, found.printed_tests
    numbers = [found.equations, found.mobility, d.RPM, d.RI, d.RO, d.II, d.IO]
    shown = (tests[key] for key in ("eq5_m_ge_a", "eq8", "eq9", "eq10"))
    marks = "".join("  + " if holds else "  - " for holds in shown)
    figures = "".join(f"{number:4d}" for number in numbers)
    return f"{label:<31}{figures}{found.redundant_equations:6d}   {marks}"


if __name__ == "__main__":
    print(f"{'':<31}   n   m RPM  RI  RO  II  IO redund.   (5) (8) (9)(10)")
    for label, name, settings in CASES:
        print(row(label, robot_of(name, settings)))
