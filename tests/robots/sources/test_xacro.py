# ruff: noqa: E501
"""Xacro as the reference implementation expands it, and nothing that could do more than compute."""

import contextlib
import io
import os
import re
from xml.etree import ElementTree

import pytest
import xacro
from xacro import substitution_args

import rnc_pin as rnc
from patience import ending_within
from places import ROOT
from rnc_pin.robots.robot_files import Packages
from rnc_pin.robots.sources.urdf import CHILDREN
from rnc_pin.robots.sources.xacro import expand
from rnc_pin.robots.sources.xacro_definitions import parameters_of
from rnc_pin.robots.sources.xacro_expressions import BUILTINS, admit, evaluate
from urdf_parts import XACRO


def by_the_library(path, arguments, packages):
    """Expansion by the reference implementation, or None if it fails."""
    found = substitution_args._eval_find
    substitution_args._eval_find = lambda name: str(packages.folder(name))
    try:
        with contextlib.redirect_stderr(io.StringIO()):
            text = xacro.process_file(str(path), mappings=dict(arguments)).documentElement.toxml()
            return ElementTree.fromstring(text)
    except Exception:  # it raises whatever Python raises
        return None
    finally:
        substitution_args._eval_find = found
        xacro.substitution_args_context["arg"] = {}


def by_us(path, arguments, packages):
    try:
        return expand(path, arguments, packages, CHILDREN)
    except rnc.RncError:
        return None


def bare(element):
    """Names without namespaces, attributes, text without space around it, and elements inside."""
    name = element.tag.rpartition("}")[2].rpartition(":")[2]
    attributes = sorted((key.rpartition("}")[2].rpartition(":")[2], text) for key, text in element.items())
    inside = [bare(each) for each in element if isinstance(each.tag, str)]
    return name, attributes, "".join((element.text or "").split()), inside


def agree(path, arguments=()):
    theirs = by_the_library(path, arguments, Packages(path.parent))
    ours = by_us(path, dict(arguments), Packages(path.parent))
    if theirs is None or ours is None:
        return theirs is ours
    return bare(theirs) == bare(ours)


def test_files_of_the_tests_expand_as_by_the_library():
    files = sorted((ROOT / "tests" / "data").rglob("*.xacro"))
    assert files
    # The library leaves a macro without its prefix alone, and urdfdom ignores it.
    assert [path.name for path in files if not agree(path)] == ["call_without_prefix.urdf.xacro"]


PARTS = """<robot {XACRO}>
  <xacro:property name="inside" value="7"/>
  <xacro:macro name="bolt" params="size"><bolt size="${size}" inside="${inside}"/></xacro:macro>
</robot>"""
SETTINGS = (
    "arm:\n  length: 1.5\n  names: [a, b]\n  deep: {items: 3, key: {x: 2}}\nangle: !degrees 90\nfoot: !foot 2*1.5\n"
)

TWICE = """link:
  inertia:
  inertia: {xx: 0.5, yy: 1}
mass: 1
base: &base {a: 1, b: 2}
merged: {<<: *base, b: 3, b: 4}
mass: 2
"""  # as in the inertials.yaml of Franka's FR3 and FP3

WHOLE = {
    "arithmetic": '<a x="${1+2*3}" y="${-2**2}" z="${7//2} ${7%4} ${2/4}" w="${1e-3}" v="${0.1+0.2}" u="${1 if 2>1 else 3}"/>',
    "functions": '<a x="${sin(pi/2)}" y="${math.radians(180)}" z="${max(1,2.5)}" w="${python.sum([1,2])}" v="${round(1.25,1)}"/>',
    "texts": """<a x="${'m'*3}" y="${'a,b'.split(',')[1]}" z="${'%s_%03d' % ('n', 7)}" w="${'_'.join(['a','b'])}"/>""",
    "lists": '<a x="${[k*2 for k in range(3)]}" y="${[1,2,3][-1]}" z="${(1,2)[0]}" w="${len([1,2])}" v="${2 in [1,2]}"/>',
    "slices": '<a x="${[1,2,3][1:]}" y="${\'abcdef\'[::2]}"/>',
    "escapes": '<a x="$${x}" y="$$(arg x)" z="100$" w="a $ b" v="$$"/>',
    "nested": '<xacro:arg name="n" default="2"/><a x="${$(arg n) * 3}" y="$(eval n * 2)" z="$(eval n)"/>',
    "properties": '<xacro:property name="a" value="${b*2}"/><xacro:property name="b" value="3"/><a x="${a}" y="${b}"/>',
    "literals": """<xacro:property name="a" value="'12'"/><xacro:property name="b" value="1_000"/><xacro:property
        name="c" value="true"/><xacro:property name="d" value="1e3"/><a x="${a*2}" y="${b}" z="${c}" w="${d}"/>""",
    "circle": '<xacro:property name="a" value="${b}"/><xacro:property name="b" value="${a}"/><a x="${a}"/>',
    "default": '<xacro:property name="a" value="1"/><xacro:property name="a" default="2"/><xacro:property name="b"'
    ' default="4"/><a x="${a}${b}"/>',
    "removal": '<xacro:property name="a" value="1"/><xacro:property name="a" remove="true"/><a x="${a}"/>',
    "eager": '<xacro:property name="a" value="1"/><xacro:property name="b" value="${a}" lazy_eval="false"/><xacro:property'
    ' name="a" value="2"/><a x="${b}"/>',
    "macro": '<xacro:macro name="m" params="x y:=2 z:=${1+1}"><b x="${x}" y="${y}" z="${z}"/></xacro:macro><xacro:m x="1"/>'
    '<xacro:m x="${1+3}" y="q"/>',
    "quoted defaults": """<xacro:macro name="m" params="x:='a b' y:=^ z:=^|5"><b x="${x}" y="${y}" z="${z}"/></xacro:macro>
        <xacro:property name="y" value="8"/><xacro:m/>""",
    "missing forward": '<xacro:macro name="m" params="y:=^"><b y="${y}"/></xacro:macro><xacro:m/>',
    "blocks": '<xacro:macro name="m" params="n *one **many"><l n="${n}"><xacro:insert_block name="one"/><xacro:insert_block'
    ' name="many"/></l></xacro:macro><xacro:property name="p" value="3"/><xacro:m n="k"><o a="${p}"/><q><r/>${p}<s/></q></xacro:m>',
    "block twice": '<xacro:macro name="m" params="*b"><xacro:insert_block name="b"/><xacro:insert_block name="b"/></xacro:macro>'
    "<xacro:m><o/></xacro:m>",
    "block of a property": '<xacro:property name="b"><c x="${n}"/><d/></xacro:property><xacro:property name="n" value="1"/>'
    '<e><xacro:insert_block name="b"/></e>',
    "block too many": '<xacro:macro name="m" params="*b"/><xacro:m><o/><o/></xacro:m>',
    "block too few": '<xacro:macro name="m" params="*b"/><xacro:m/>',
    "scope": '<xacro:macro name="m" params=""><xacro:property name="a" value="1" scope="parent"/><xacro:property name="b" '
    'value="2" scope="global"/><xacro:property name="c" value="3"/></xacro:macro><xacro:macro name="o"><xacro:m/>'
    '<x a="${a}"/></xacro:macro><xacro:o/><y b="${b}"/>',
    "scope stays inside": '<xacro:macro name="m"><xacro:property name="c" value="3"/></xacro:macro><xacro:m/><a x="${c}"/>',
    "dynamic scope": '<xacro:macro name="i"><b x="${v}"/></xacro:macro><xacro:macro name="o" params="v"><xacro:i/></xacro:macro>'
    '<xacro:o v="5"/>',
    "recursion": '<xacro:macro name="m" params="n"><l n="${n}"/><xacro:if value="${n>0}"><xacro:m n="${n-1}"/></xacro:if>'
    '</xacro:macro><xacro:m n="20"/>',
    "conditions": '<xacro:if value="1"><a/></xacro:if><xacro:unless value="false"><b/></xacro:unless><xacro:if value="${[]}">'
    '<c/></xacro:if><xacro:if value="${1 == 1}"><d/></xacro:if>',
    "no truth": '<xacro:if value="maybe"/>',
    "include": '<xacro:include filename="parts.xacro"/><xacro:bolt size="3"/>',
    "include with a name": '<xacro:include filename="parts.xacro" ns="p"/><xacro:p.bolt size="3"/><a x="${p.inside}"/>',
    "include none": '<xacro:include filename="none.xacro"/>',
    "include perhaps": '<xacro:include filename="none.xacro" optional="true"/><a/>',
    "inside a macro": '<xacro:macro name="o"><xacro:macro name="i"><z/></xacro:macro><xacro:i/></xacro:macro><xacro:o/><xacro:i/>',
    "YAML": """<xacro:property name="s" value="${xacro.load_yaml('settings.yaml')}"/><a x="${s.arm.length}" y="${s['arm']['names'][1]}"
        z="${s.arm.deep.key.x}" w="${s['angle']}" v="${s.foot}" u="${list(s.arm.keys())}"/>""",
    "argument": """<a y="${xacro.arg('k')}"/>""",
    "argument in any case": """<xacro:arg name="w" default="TRUE"/><xacro:arg name="q" default="'a'"/><a x="$(eval w)" y="$(eval q)"/>""",
    "dictionary": '<xacro:property name="d" value="${dict(a=1, b=[2, 3])}"/><a x="${d[\'b\'][0]}" y="${[k for k in d]}"/>',
    "text between": "<a>${1+1} and <b/> $(arg k)</a>",
    "comments": "<!-- ${nothing} --><a/><!-- more -->",
    "unknown macro": "<xacro:nobody/>",
    "unknown name": '<a x="${nobody}"/>',
    "wrong parameter": '<xacro:macro name="m" params="x"/><xacro:m y="1"/>',
    "no end": '<a x="${1"/>',
    "eval without a space": '<a x="$(eval)"/>',
    "eval after a tab": '<a x="$(eval&#9;1)"/>',
    "bad name": '<xacro:property name="1a" value="2"/>',
    "environment": '<a x="$(optenv NOT_THERE some thing)" y="$(optenv NOT_THERE)"/>',
    "key twice": """<xacro:property name="s" value="${xacro.load_yaml('twice.yaml')}"/><a x="${s.link.inertia.xx}" y="${s.mass}"
        z="${s.merged}"/>""",
    "division": '<a x="${1/0}"/>',
}


@pytest.mark.parametrize("name", WHOLE)
def test_each_thing_that_xacro_does_is_done_as_by_the_library(name, tmp_path):
    (tmp_path / "parts.xacro").write_text(PARTS.replace("{XACRO}", XACRO))
    (tmp_path / "settings.yaml").write_text(SETTINGS)
    (tmp_path / "twice.yaml").write_text(TWICE)
    path = tmp_path / "robot.xacro"
    path.write_text(f'<robot name="r" {XACRO}><xacro:arg name="k" default="v"/>{WHOLE[name]}</robot>')
    assert agree(path)


def test_parameters_of_many_letters_are_read():
    """The library's pattern takes time that doubles with each letter here."""
    element = ElementTree.Element("macro", {"params": f"x:={'a' * 5000}'"})
    with ending_within(1):
        assert len(list(parameters_of(element.get("params")))) == 1


# What could do more than compute.
MORE = ("().__class__", "(lambda: 1)()", "9**9**9", "'a' * 10**9", "str.mro()", "math.update(dict(pi=3))")  # fmt: skip


def expanded(tmp_path, inside, arguments=None):
    path = tmp_path / "r.xacro"
    path.write_text(f'<robot name="r" {XACRO}>{inside}</robot>')
    return expand(path, arguments, Packages(tmp_path), CHILDREN)


@pytest.mark.parametrize("inside", [
    """<xacro:property name="e" value="exec(&quot;import os;os.system('touch {mark}')&quot;,dict())"/><link name="$(eval ${e})"/>""",
    """<link name="$(eval exec('import os;os.system(chr(116))'))"/>""",
    """<xacro:property name="e" value="open('{mark}', 'w')"/><link name="$(eval ${e})"/>""",
    """<link name="${exec('x')}"/>""",
    """<link name="${__import__('os').system('touch {mark}')}"/>""",
])  # fmt: skip
def test_no_file_runs_a_program(inside, tmp_path):
    mark = tmp_path / "mark"
    with pytest.raises(rnc.ModelError):
        expanded(tmp_path, inside.replace("{mark}", str(mark)))
    assert not mark.exists()


@pytest.mark.parametrize("expression", [
    "().__class__", "(lambda: 1)()", "[c for c in ().__class__.__base__.__subclasses__()]",
    "[k for k in [1] if k.gi_frame]", "(k for k in [1])", "__import__('os')", "max.__self__", "max.run", "max._run",
    "math._members", "math.member('pi')", "math.update(dict(pi=3))", "python._members", "'{0.real}'.format(1)",
    "'{0.real}'.format_map(dict())", "f'{pi}'", "str.mro()", "(y := 3)", "9**9**9", "(10**100)**100", "1 << 10**10",
    "{k: 1 for k in [1]}", "dict(**dict(a=1))", "{**dict(a=1)}", "[1].append(2)", "dict(a=1).update(b=2)",
    "python.vars(1)", "python['vars'](1)", "python.type(1)", "xacro", "'a' * 10**9", "10**9 * 'a'", "[0] * 10**9",
    "'%1000000000d' % 1", "'%*d' % (10**9, 1)", "'a'.zfill(10**9)", "('a' * 99999).replace('a', 'b' * 9999)",
    "range(10**12)", "[i for i in range(9999) for j in range(9999) if False]", "round(5, -10**9)", "sorted([1], key=len)",
    "math.factorial(10**6)", "int('f' * 99999, 16)", "1j", "b'1'", "...", "(-8)**0.5", "import os", "", "\0", "~1",
    "(" * 3000, "-" * 3999 + "1", "[" * 150 + "]" * 150, "+".join("1" * 1900), "1" + "0" * 3999, "x" * 5000,
])  # fmt: skip
def test_an_expression_computes_or_is_refused_at_once(expression):
    said = ""
    with ending_within(5):
        try:
            admit(evaluate(expression, BUILTINS))
        except rnc.ModelError as error:
            said = str(error)
    assert len(said) < 300
    assert expression not in MORE or re.search("refuses to evaluate|math", said)


def test_no_property_leads_to_the_document(tmp_path):
    """In the library a block is a DOM node, from which a file reached the network."""
    block = '<xacro:property name="b"><c/></xacro:property>'
    module = '<xacro:include filename="parts.xacro" ns="foo"/>'
    (tmp_path / "parts.xacro").write_text(f"<robot {XACRO}>{block}</robot>")
    for expression in ("foo.get('**b')", "foo['**b']", "foo.b", "foo.ownerDocument", "foo.scope", "foo"):
        with pytest.raises(rnc.ModelError):
            expanded(tmp_path, f'{block}{module}<a x="${{{expression}}}"/>')


def test_symbols_are_made_anew_for_each_file(tmp_path):
    with pytest.raises(rnc.ModelError):
        expanded(tmp_path, '<a x="${math.update(dict(pi=3))}"/>')
    expanded(tmp_path, '<xacro:property name="pi" value="3" scope="global"/><xacro:property name="math" value="4"/>')
    found = expanded(tmp_path, '<a x="${math.pi}" y="${pi}"/>')[0]
    assert found.attrib == {"x": "3.141592653589793", "y": "3.141592653589793"}


def test_the_environment_is_read_by_a_list(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "hush")
    monkeypatch.setenv("TURTLEBOT3_MODEL", "burger")
    found = expanded(tmp_path, '<a x="$(env TURTLEBOT3_MODEL)" y="$(optenv SECRET none)"/>')[0]
    assert found.attrib == {"x": "burger", "y": "none"}
    for text in ("$(env SECRET)", "$(eval env('SECRET')", "${xacro.load_yaml('$(env SECRET)')}"):
        with pytest.raises(rnc.ModelError) as raised:
            expanded(tmp_path, f'<a x="{text}"/>')
        assert "hush" not in str(raised.value)
    with pytest.raises(rnc.ModelError, match="a file may not read environment variable"):
        expanded(tmp_path, '<a x="$(env SECRET)"/>')


@pytest.mark.parametrize("inside", [
    "".join(f'<xacro:macro name="m{k}">{f"<xacro:m{k + 1}/>" * 9}</xacro:macro>' for k in range(20))
    + '<xacro:macro name="m20"/><xacro:m0/>',
    '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
    '<xacro:property name="a0" value="${[1,1]}"/>'
    + "".join(f'<xacro:property name="a{k + 1}" value="${{[a{k},a{k}]}}"/>' for k in range(40))
    + '<a x="${a40}"/>',
    '<xacro:property name="a0" value="${2}"/>'
    + "".join(f'<xacro:property name="a{k + 1}" value="${{a{k}*a{k}}}"/>' for k in range(60))
    + '<a x="${a60}"/>',
    '<xacro:property name="a0" value="xxxxxxxxxxxxxxxx"/>'
    + "".join(f'<xacro:property name="a{k + 1}" value="${{a{k}}}${{a{k}}}"/>' for k in range(60))
    + '<a x="${a60}"/>',
    "<a>" * 10_000 + "</a>" * 10_000,
    '<xacro:include filename="/dev/zero"/>',
    '<xacro:include filename="pipe"/>',
    "<a x=\"${xacro.load_yaml('/dev/zero')}\"/>",
    "<a x=\"${xacro.load_yaml('pipe')}\"/>",
    "<a x=\"${xacro.load_yaml('bomb.yaml')}\"/>",
])  # fmt: skip
def test_a_file_that_would_not_end_is_refused(inside, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    lines = (f"a{k + 1}: &a{k + 1} {{<<: [{', '.join([f'*a{k}'] * 9)}]}}\n" for k in range(9))
    (tmp_path / "bomb.yaml").write_text("a0: &a0 {x: 1}\n" + "".join(lines))
    with ending_within(20), pytest.raises(rnc.ModelError):
        expanded(tmp_path, inside)


BRACKET = '<xacro:macro name="bracket"><link name="b"/></xacro:macro>'


@pytest.mark.parametrize(("inside", "words"), [
    (f"{BRACKET}\n<bracket/>", "element <bracket>: a macro of this name exists; write <xacro:bracket> (line 2)"),
    (f'{BRACKET}<link name="a">\n<bracket/></link>', "write <xacro:bracket> (line 2)"),
    (f'{BRACKET}<xacro:if value="1">\n<bracket/></xacro:if>', "write <xacro:bracket> (line 2)"),
    ('<include filename="parts.xacro"/>', "xacro has an element of this name; write <xacro:include> (line 1)"),
])  # fmt: skip
def test_a_macro_without_its_prefix_is_refused(inside, words, tmp_path):
    with pytest.raises(rnc.ModelError) as raised:
        expanded(tmp_path, inside)
    assert str(raised.value).endswith(words)


def test_elements_of_a_urdf_and_of_simulators_may_have_the_name_of_a_macro(tmp_path):
    macros = "".join(f'<xacro:macro name="{name}"><{name}/></xacro:macro>' for name in ("inertial", "camera", "bolt"))
    plain = '<link name="a"><inertial/></link><gazebo><sensor><camera/></sensor></gazebo>'
    root = expanded(tmp_path, f"{macros}{plain}<xacro:bolt/>")
    found = [" ".join(each.tag for each in child.iter()) for child in root]
    assert found == ["link inertial", "gazebo sensor camera", "bolt"]


@pytest.mark.parametrize(("part", "call", "words"), [
    ("<a\n x='${nobody}'/>", "", "(in {parts}, line 2)"),
    ("<xacro:macro name='m'>\n<a>\n<b x='${nobody}'/></a></xacro:macro>", "<xacro:m/>", "(in {parts}, line 4)"),
    ("<xacro:macro name='m' params='x'>\n<a/></xacro:macro>", "\n<xacro:m y='1'/>", "(line 2)"),
    ("<a>", "", "not well-formed XML: mismatched tag: line 2, column 5 (in {parts})"),
])  # fmt: skip
def test_an_error_names_the_file_and_the_line_that_it_is_in(part, call, words, tmp_path):
    parts = tmp_path / "parts.xacro"
    parts.write_text(f"<robot {XACRO}>\n{part}</robot>")
    with pytest.raises(rnc.ModelError) as raised:
        expanded(tmp_path, f'<xacro:include filename="parts.xacro"/>{call}')
    assert str(raised.value).startswith(f"{tmp_path / 'r.xacro'}: xacro: ")
    assert str(raised.value).endswith(words.format(parts=parts))


@pytest.mark.parametrize(("expression", "value"), [
    ("a.b['c'][1]", 2), ("-x**2", -4), ("'m' if x > 1 else 'n'", "m"), ("name + '_link'", "arm_link"), ("1 < x <= 2", True),
    ("[i + j for i, j in [(1, 2), (3, 4)] if i > 1]", [7]), ("a.get('z', 5)", 5), ("not x or name", "arm"),
    ("sorted([3, 1], reverse=True)", [3, 1]),
])  # fmt: skip
def test_values_inside_are_those_of_the_file(expression, value):
    assert evaluate(expression, {**BUILTINS, "a": {"b": {"c": [1, 2]}}, "x": 2, "name": "arm"}) == value
