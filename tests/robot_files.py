"""Robot files that the tests share: a minimal one, one with everything, and a good one with ways to spoil it."""
# ruff: noqa: E501  (tables, one case per line)

from __future__ import annotations

from pathlib import Path

from armonic import catalog
from armonic.description.document import MAX_DEPTH

START = Path(catalog.__file__).parent.parent / "examples" / "kuka_start.yaml"

MINIMAL = """\
armonic: 1
name: minimal
links: [{name: a, parent: base, joint: {type: revolute, axis: z}}]"""

# A robot with everything a file can hold: a child before its parent, a free vector as axis, slides, bushings.
ZOO = """\
armonic: 1
name: Zoo   # a comment
postures:
  home: [30 deg, 0.5, 250 mm]
links:
  - name: slide   # its parent stands below
    parent: turret
    placement: [{x: 100 mm, y: 2 cm}, {rz: 90 deg}]
    joint: {type: prismatic, axis: y}
    elasticity:
      tx: {stiffness: 2 kN/mm, damping: 3 N s/mm}
      ty: {stiffness: 4.0e6}   # from the data sheet
      x:
        stiffness: 7 kN m/rad   # guessed
        damping: 12
    mass: 500 g
    com: [1 mm, 0, 0]
    inertia: {xx: 2000 kg mm^2, yy: 1, zz: 1}
  - name: turret
    parent: base
    joint: {type: revolute, axis: [0, 3, 4]}
    elasticity: {joint: {stiffness: 1.0e5, stiffness_bounds: [1.0e4, 1 MN m/rad]}, tz: free}
    mass: 1 t
    inertia: {xx: 10, yy: 10, zz: 10}
  - {name: lift, parent: slide, joint: {type: prismatic, axis: [1, 0, 0]}, mass: 2}
  - {name: plate, parent: lift, joint: {type: fixed}, mass: 1, placement: [{z: 1}]}
frames:
  - {name: tip, link: plate, placement: [{rx: 90 deg}, {z: 2}]}
  - {name: floor, link: base, placement: [{x: -1}]}
bushings:
  - {name: cable, between: [floor, tip], stiffness: [1, 2, 3, 4, 5, 0], rest: home}
  - name: mount
    between: [base, turret]
    stiffness:
      - [1.0e3, 0, 0, 0, 10, 0]
      - [0, 1 N/mm, 0, 0, 0, 0]
      - [0, 0, 1.0e3, 0, 0, 0]
      - [0, 0, 0, 5, 0, 0]
      - [10 N, 0, 0, 0, 6, 0]
      - [0, 0, 0, 0, 0, 7]
    damping: [1, 1, 1, 2, 2, 2]
"""

GOOD = """\
armonic: 1
name: Test arm
source: a test
gravity: [0, 0, -9.81]
links:
  - name: first
    parent: base
    placement: [{z: 1}]
    joint: {type: revolute, axis: z}
    elasticity:
      z: {stiffness: 1.0e6, damping: 10}
      x: free
    mass: 10
    com: [0, 0, 0.1]
    inertia: {xx: 1, yy: 1, zz: 1}
  - name: second
    parent: first
    joint: {type: prismatic, axis: [0, 1, 1]}
    elasticity:
      joint: {stiffness: 1.0e6, stiffness_bounds: [1, 1.0e9]}
    mass: 5
  - {name: third, parent: second, joint: {type: fixed}, mass: 1}
frames:
  - {name: tip, link: third, placement: [{x: 1}, {rx: 90 deg}]}
postures:
  home: [30 deg, 20 mm]
bushings:
  - {name: pad, between: [base, tip], stiffness: [1, 1, 1, 1, 1, 1], damping: [1, 0, 0, 0, 0, 0], rest: home}
"""

# Two motors, one on a slide; a tool and a path.
DRIVEN = """\
armonic: 1
name: Driven arm
links:
  - name: rail
    parent: base
    dh: {theta: 90 deg, d: 0.1}
    joint: {type: prismatic}
    drive: {gear_ratio: 50, rotor_inertia: 1.0e-4, shaft_stiffness: 2.0e4, joint_damping: 3 N s/m, radius: 57 mm}
    mass: 10
  - name: arm
    parent: rail
    joint: {type: revolute, axis: y}
    elasticity: {x: {stiffness: 1.0e6}}
    drive:
      gear_ratio: 100
      rotor_inertia: 2.0e-4
      shaft_stiffness: 3.0e4
    mass: 5
    inertia: {xx: 1, yy: 1, zz: 1}
  - {name: hand, parent: arm, joint: {type: fixed}, mass: 1}
frames:
  - {name: tip, link: hand, placement: [{x: 1}]}
  - {name: floor, link: base}
tool: {frame: tip, mass: 2, com: [0, 0, 0.1], inertia: {xx: 1, yy: 1, zz: 1}}
control:
  kp: [100, 200]
  kd: 3
  state_feedback:
    position: [[1, 2, 3, 4], [5, 6, 7, 8]]
postures:
  home: [0.1, 30 deg]
paths:
  way: {through: [home, [0, 0]], points: 5}
"""

# old text -> new text, then line, dotted path, part of found, part of expected, part of the hint
SCHEMA_FAULTS = {
    "no version": ("armonic: 1\n", "", 1, "", "no armonic", "key armonic", ""),
    "other version": ("armonic: 1", "armonic: 2", 1, "armonic", "2", "1", "format 1"),
    "version as text": ("armonic: 1", "armonic: '1'", 1, "armonic", "'1'", "1", ""),
    "version true": ("armonic: 1", "armonic: true", 1, "armonic", "true", "1", ""),
    "number as name": ("Test arm", "7", 2, "name", "7", "a text", "quotes"),
    "blank name": ("Test arm", "' '", 2, "name", "' '", "not empty", ""),
    "unknown top key": ("source:", "sauce:", 3, "sauce", "unknown key 'sauce'", "source", "source?"),
    "gravity too short": ("[0, 0, -9.81]", "[0, -9.81]", 4, "gravity", "a list of 2", "three numbers", ""),
    "gravity in kg": ("-9.81]", "9.81 kg]", 4, "gravity[2]", "'9.81 kg'", "m/s^2", "measures mass"),
    "no links": (GOOD[GOOD.index("links:") : GOOD.index("frames:")], "links: []\n", 5, "links", "empty", "one", ""),
    "links no list": ("links:\n", "links: 5\nlonks:\n", 5, "links", "5", "a list", "1 more error"),
    "link no mapping": ("  - name: first\n", "  - 5\n  - name: first\n", 6, "links[0]", "5", "a link", ""),
    "link unnamed": ("  - name: first\n    parent", "  - parent", 6, "links[0]", "no name", "key name", ""),
    "bad name": ("name: first", "name: 1st axis", 6, "links.1st axis.name", "'1st axis'", "a letter", ""),
    "link called base": ("name: first", "name: base", 6, "links.base.name", "'base'", "another", "ground"),
    "name twice": ("name: second", "name: first", 16, "links.first.name", "'first' again", "no other", ""),
    "unknown parent": ("parent: first", "parent: fist", 17, "links.second.parent", "'fist'", "link", "first?"),
    "own parent": ("parent: first", "parent: second", 17, "links.second.parent", "second -> second", "base", ""),
    "cycle": ("parent: base", "parent: third", 7, "links.first.parent", "first -> third -> second -> first", "", ""),
    "placement no list": ("[{z: 1}]", "{z: 1}", 8, "links.first.placement", "a mapping", "a list", ""),
    "motion no mapping": ("[{z: 1}]", "[1]", 8, "links.first.placement[0]", "1", "{x: 350 mm}", ""),
    "motion empty": ("[{z: 1}]", "[{}]", 8, "links.first.placement[0]", "no key", "one of rx", "left to right"),
    "two turns": ("{z: 1}", "{rx: 1, ry: 1}", 8, "links.first.placement[0]", "rx, ry", "one of rx", "own entry"),
    "turn and move": ("{z: 1}", "{z: 1, ry: 1}", 8, "links.first.placement[0]", "z, ry", "one of rx", ""),
    "motion misspelt": ("{z: 1}", "{rot: 1}", 8, "links.first.placement[0].rot", "'rot'", "rx, ry, rz", ""),
    "length as angle": ("{z: 1}", "{z: 5 deg}", 8, "links.first.placement[0].z", "'5 deg'", "m, cm, mm", "angle"),
    "angle as length": ("rx: 90 deg", "rx: 9 mm", 24, "frames.tip.placement[1].rx", "'9 mm'", "deg", "length"),
    "no joint": ("    joint: {type: revolute, axis: z}\n", "", 6, "links.first", "no joint", "key joint", ""),
    "joint type": ("revolute", "revolut", 9, "links.first.joint.type", "'revolut'", "prismatic", "revolute?"),
    "joint no axis": (", axis: z", "", 9, "links.first.joint", "no axis", "revolute", ""),
    "fixed with axis": ("fixed}", "fixed, axis: x}", 22, "links.third.joint.axis", "fixed joint", "no axis", ""),
    "axis letter": ("axis: z", "axis: w", 9, "links.first.joint.axis", "'w'", "x, y, z", ""),
    "axis short": ("[0, 1, 1]", "[0, 1]", 18, "links.second.joint.axis", "a list of 2", "three", ""),
    "axis zero": ("[0, 1, 1]", "[0, 0, 0]", 18, "links.second.joint.axis", "zero vector", "not zero", ""),
    "axis unit": ("[0, 1, 1]", "[0, 1 m, 1]", 18, "links.second.joint.axis[1]", "'1 m'", "a number", ""),
    "elasticity no mapping": (
        "elasticity:\n      joint: {stiffness: 1.0e6, stiffness_bounds: [1, 1.0e9]}",
        "elasticity: 3",
        19,
        "links.second.elasticity",
        "3",
        "a mapping",
        "",
    ),
    "axis key": ("x: free", "rx: free", 12, "links.first.elasticity.rx", "'rx'", "one of x, y, z, tx", ""),
    "joint key": ("x: free", "joint: free", 12, "links.first.elasticity.joint", "'joint'", "tz", "called z"),
    "spring word": ("x: free", "x: fre", 12, "links.first.elasticity.x", "'fre'", "the word free", ""),
    "spring empty": ("x: free", "x:", 12, "links.first.elasticity.x", "nothing", "stiffness", ""),
    "spring key": ("damping: 10", "dampin: 10", 11, "links.first.elasticity.z.dampin", "'dampin'", "damping", "damping?"),
    "no stiffness": ("stiffness: 1.0e6, d", "d", 11, "links.first.elasticity.z", "no stiffness", "key stiffness", ""),
    "zero stiffness": ("1.0e6, d", "0, d", 11, "links.first.elasticity.z.stiffness", "0", "positive", ""),
    "negative damping": ("damping: 10", "damping: -1", 11, "links.first.elasticity.z.damping", "-1", "0 or larger", ""),
    "stiffness of a slide": ("1.0e6, d", "5 N/mm, d", 11, "links.first.elasticity.z.stiffness", "'5 N/mm'", "N m/rad", ""),
    "stiffness of a turn": ("1.0e6, s", "5 N m/rad, s", 20, "links.second.elasticity.joint.stiffness", "'5 N m/rad'", "N/mm", ""),
    "bounds short": ("[1, 1.0e9]", "[1]", 20, "links.second.elasticity.joint.stiffness_bounds", "a list of 1", "[lowest", ""),
    "bounds upside down": ("[1, 1.0e9]", "[9, 1]", 20, "links.second.elasticity.joint.stiffness_bounds", "[9, 1]", "smaller", ""),
    "bounds from zero": ("[1, 1.0e9]", "[0, 1.0e9]", 20, "links.second.elasticity.joint.stiffness_bounds", "[0,", "positive", ""),
    "value out of bounds": ("[1, 1.0e9]", "[1, 9]", 20, "links.second.elasticity.joint.stiffness_bounds", "[1, 9]", "1e+06", ""),
    "bound no number": ("[1, 1.0e9]", "[1, much]", 20, "links.second.elasticity.joint.stiffness_bounds[1]", "'much'", "N/m", ""),
    "negative mass": ("mass: 10", "mass: -10", 13, "links.first.mass", "-10", "0 or larger", ""),
    "mass true": ("mass: 10", "mass: true", 13, "links.first.mass", "true", "a number in kg", ""),
    "mass missing value": ("mass: 10", "mass:", 13, "links.first.mass", "nothing", "kg", ""),
    "mass infinite": ("mass: 10", "mass: .inf", 13, "links.first.mass", "inf", "finite", ""),
    "mass nan": ("mass: 10", "mass: .nan", 13, "links.first.mass", "nan", "finite", ""),
    "mass overflow": ("mass: 10", "mass: 1.0e999", 13, "links.first.mass", "inf", "finite", ""),
    "mass of many digits": ("mass: 10", f"mass: {'9' * 5000}", 13, "links.first.mass", "inf", "finite", ""),
    "mass with comma": ("mass: 10", "mass: 10,5 kg", 13, "links.first.mass", "'10,5 kg'", "kg, g, t", "decimal point"),
    "mass unknown unit": ("mass: 10", "mass: 10 lbs", 13, "links.first.mass", "'10 lbs'", "kg, g, t", "not known"),
    "mass hexadecimal": ("mass: 10", "mass: 0x1F", 13, "links.first.mass", "'0x1F'", "kg", ""),
    "com no list": ("[0, 0, 0.1]", "0.1", 14, "links.first.com", "0.1", "three numbers", ""),
    "com entry": ("[0, 0, 0.1]", "[0, here, 0.1]", 14, "links.first.com[1]", "'here'", "mm", ""),
    "inertia key": ("zz: 1}", "zx: 1}", 15, "links.first.inertia.zx", "'zx'", "xx, yy, zz, xy, xz, yz", "Did you mean"),
    "inertia list": ("{xx: 1, yy: 1, zz: 1}", "[1, 1, 1]", 15, "links.first.inertia", "a list of 3", "xx, yy", ""),
    "inertia without mass": ("mass: 10\n", "mass: 0\n", 15, "links.first.inertia", "without a mass", "positive mass", ""),
    "frame link": ("link: third", "link: thrid", 24, "frames.tip.link", "'thrid'", "a link", "third?"),
    "frame taken": ("name: tip", "name: third", 24, "frames.third.name", "'third' again", "frame or link", ""),
    "frame called base": ("name: tip", "name: base", 24, "frames.base.name", "'base' again", "frame or link", ""),
    "frame without link": ("link: third, ", "", 24, "frames.tip", "no link", "key link", ""),
    "postures no mapping": ("\n  home: [30 deg, 20 mm]", " [1]", 25, "postures", "a list of 1", "a mapping", ""),
    "posture no list": ("[30 deg, 20 mm]", "30", 26, "postures.home", "30", "a list", ""),
    "posture length": ("[30 deg, 20 mm]", "[1, 2, 3]", 26, "postures.home", "a list of 3", "a list of 2: first.z, second.joint", ""),
    "posture unit": ("30 deg, 20 mm", "30 deg, 20 deg", 26, "postures.home[1]", "'20 deg'", "m, cm", "an angle"),
    "posture nested": ("30 deg, 20 mm", "[1], 2", 26, "postures.home[0]", "a list of 1", "rad", ""),
    "posture name": ("home: [", "my home: [", 26, "postures.my home", "'my home'", "a letter", ""),
    "between short": ("[base, tip]", "[tip]", 28, "bushings.pad.between", "a list of 1", "two frames", ""),
    "between same": ("[base, tip]", "[tip, tip]", 28, "bushings.pad.between", "'tip' twice", "different", ""),
    "between unknown": ("[base, tip]", "[base, tap]", 28, "bushings.pad.between[1]", "'tap'", "frame or link", "tip?"),
    "bushing soft": ("[1, 1, 1, 1, 1, 1]", "[0, 0, 0, 0, 0, 0]", 28, "bushings.pad.stiffness", "six zeros", "one", ""),
    "bushing short": ("[1, 1, 1, 1, 1, 1]", "[1, 1, 1]", 28, "bushings.pad.stiffness", "a list of 3", "six numbers", ""),
    "bushing negative": ("[1, 1, 1, 1, 1, 1]", "[1, 1, -1, 1, 1, 1]", 28, "bushings.pad.stiffness[2]", "-1", "0 or", ""),
    "bushing unit": ("[1, 1, 1, 1, 1, 1]", "[1, 1, 1, 1, 1, 1 N/m]", 28, "bushings.pad.stiffness[5]", "'1 N/m'", "N m/rad", ""),
    "bushing rest": ("rest: home", "rest: hime", 28, "bushings.pad.rest", "'hime'", "a posture", "home?"),
    "bushing rest length": ("rest: home", "rest: [1]", 28, "bushings.pad.rest", "a list of 1", "a list of 2", ""),
    "bushing rest unit": ("rest: home", "rest: [1, 1 kg]", 28, "bushings.pad.rest[1]", "'1 kg'", "mm", "mass"),
    "bushing rest number": ("rest: home", "rest: 5", 28, "bushings.pad.rest", "5", "a posture", ""),
    "bushing again": (
        "bushings:\n",
        "bushings:\n  - {name: pad, between: [base, third], stiffness: [1, 1, 1, 1, 1, 1]}\n",
        29,
        "bushings.pad.name",
        "'pad' again",
        "bushing",
        "",
    ),
}  # fmt: skip

# text, then line and dotted path, part of found, part of expected
YAML_FAULTS = {
    "empty": ("", "1", "an empty file", "armonic: 1"),
    "comment only": ("# nothing\n", "1", "an empty file", "armonic: 1"),
    "null": ("~", "1", "nothing", "armonic: 1"),
    "a list": ("- armonic: 1\n", "1", "a list of 1", "armonic: 1"),
    "a text": ("hello", "1", "'hello'", "armonic: 1"),
    "anchor": (
        GOOD.replace("[{z: 1}]", "&here [{z: 1}]"),
        "8, links.first.placement",
        "anchor (`&here`)",
        "plain values",
    ),
    "alias": (
        GOOD.replace("[{z: 1}]", "*there"),
        "8, links.first.placement",
        "alias (`*there`)",
        "plain values",
    ),
    "tag": (GOOD.replace("mass: 10", "mass: !!float 10"), "13, links.first.mass", "tag", "plain values"),
    "python tag": (
        GOOD.replace("Test arm", "!!python/object/apply:os.system ['true']"),
        "2, name",
        "python/object/apply:os.system",
        "plain values",
    ),
    "tagged mapping": ("!robot\n" + GOOD, "1", "!robot", "plain values"),
    "duplicate key": (
        GOOD.replace("mass: 10", "mass: 10\n    mass: 11"),
        "14, links.first",
        "the key 'mass' again",
        "line 13",
    ),
    "duplicate link key": (GOOD + "name: again\n", "29", "the key 'name' again", "line 2"),
    "two documents": (GOOD + "---\n" + GOOD, "29", "second document", "one document"),
    "version directive": ("%YAML 1.1\n---\n" + GOOD, "1", "directive", "none"),
    "tag directive": ("%TAG ! tag:example.com:\n---\n" + GOOD, "1", "directive", "none"),
    "number as key": (GOOD.replace("home:", "7:"), "26, postures", "7 as a key", "a text"),
    "list as key": (GOOD.replace("home:", "? [a]\n  :"), "26, postures", "a collection as a key", "a text"),
    "merge": (GOOD.replace("name: tip", "<<: {name: tip}"), "24, frames[0].<<", "unknown key '<<'", "name"),
    "tab": (GOOD.replace("    parent: base", "\tparent: base"), "7, links.first", "", "well-formed YAML"),
    "unclosed": (GOOD.replace("[0, 0, -9.81]", "[0, 0"), "5, gravity", "", "well-formed YAML"),
    "unclosed quote": (
        GOOD.replace("Test arm", "'Test arm"),
        "28, name",
        "unexpected end",
        "well-formed YAML",
    ),
    "bad indent": (GOOD.replace("    mass: 10", "   mass: 10"), "13, links", "", "well-formed YAML"),
    "control character": (GOOD.replace("a test", "a\x07test"), "3", "character", "printable"),
    "escaped control": (GOOD.replace("a test", '"\\e[31m"'), "3, source", "control character", "printable"),
    "lone surrogate": (GOOD.replace("a test", '"\\ud800"'), "3, source", "control character", "printable"),
    "impossible escape": (GOOD.replace("a test", '"\\UFFFFFFFF"'), "3, source", "parser", "well-formed YAML"),
    "too deep": (
        GOOD.replace("a test", "[" * 50 + "]" * 50),
        "3, source[0][0][0][0][0][0][0][0][0][0][0][0][0][0]",
        f"deeper than {MAX_DEPTH}",
        "levels",
    ),
    "absurdly deep": (
        "[" * 100_000,
        "1, [0][0][0][0][0][0][0][0][0][0][0][0][0][0][0]",
        f"deeper than {MAX_DEPTH}",
        "levels",
    ),
    "deep blocks": (
        "- " * 100_000,
        "1, [0][0][0][0][0][0][0][0][0][0][0][0][0][0][0]",
        f"deeper than {MAX_DEPTH}",
        "levels",
    ),
    "deep keys": ("? " * 100_000, "1", "a collection as a key", "a text"),
}
