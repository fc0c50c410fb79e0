"""Parameter files of ground stations with some values changed, and nothing else."""

import codecs

import pytest

import flighttune as ft
from flighttune.logs.parameter_file import changed_text, new_text
from flighttune.logs.parameters import flown_now

QGC = (
    "# Onboard parameters for Vehicle 1\n#\n# Stack: PX4 Pro\n# Vehicle: Fixed Wing\n"
    "# Version: 1.14.0 \n#\n# Vehicle-Id Component-Id Name Value Type\n"
    "1\t1\tFW_T_ALT_TC\t5.000000000000000000\t9\n"
    "1\t1\tNPFG_PERIOD\t10.000000000000000000\t9\n"
    "1\t1\tNPFG_PERIOD_SF\t1.500000000000000000\t9\n"
    "1\t42\tNPFG_PERIOD\t10.000000000000000000\t9\n"
)
PLANNER = "NAVL1_DAMPING,0.75\r\nNAVL1_PERIOD,17\r\nTECS_TIME_CONST,5\r\n"
SPACED = "#NOTE: plane\n\nNAVL1_PERIOD      17.000000   # as flown\nMIX_NAVL1_PERIOD 1\n"
READ_ONLY = "NAVL1_PERIOD 17 @READONLY\nNAVL1_DAMPING 0.75"


def written(tmp_path, text, changes, comment=("what was flown",)):
    path = tmp_path / "plane.params"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return changed_text(path, changes, comment)


@pytest.mark.parametrize(
    ("text", "changes", "lines"),
    [
        (
            QGC,
            {"NPFG_PERIOD": 6.21},
            {
                7: "# what was flown\n1\t1\tFW_T_ALT_TC\t5.000000000000000000\t9\n",
                8: "1\t1\tNPFG_PERIOD\t6.21\t9\n",
            },
        ),
        (
            PLANNER,
            {"NAVL1_PERIOD": 12.5, "TECS_TIME_CONST": 3.0},
            {
                0: "# what was flown\r\nNAVL1_DAMPING,0.75\r\n",
                1: "NAVL1_PERIOD,12.5\r\n",
                2: "TECS_TIME_CONST,3\r\n",
            },
        ),
        (
            SPACED,
            {"NAVL1_PERIOD": 12.5},
            {2: "# what was flown\nNAVL1_PERIOD      12.5   # as flown\n"},
        ),
        (
            READ_ONLY,
            {"NAVL1_DAMPING": 0.8},
            {0: "# what was flown\nNAVL1_PERIOD 17 @READONLY\n", 1: "NAVL1_DAMPING 0.8"},
        ),
    ],
)
def test_changed_values_alone_change_and_all_else_stays_to_the_byte(tmp_path, text, changes, lines):
    found = written(tmp_path, text, changes)
    expected = text.splitlines(keepends=True)
    for place, line in lines.items():
        expected[place] = line
    assert found == "".join(expected)


def test_a_mark_of_the_byte_order_stays_in_front(tmp_path):
    found = written(tmp_path, codecs.BOM_UTF8 + PLANNER.encode(), {"NAVL1_PERIOD": 12.0})
    assert found.encode().startswith(codecs.BOM_UTF8 + b"# what was flown\r\n")


def test_a_name_that_the_file_lacks_is_refused(tmp_path):
    with pytest.raises(ft.InputError, match="must have TECS_PTCH_DAMP, got none"):
        written(tmp_path, PLANNER, {"TECS_PTCH_DAMP": 0.4})


@pytest.mark.parametrize("px4", [True, False])
def test_a_file_of_changed_parameters_alone_is_read_back(tmp_path, px4):
    changes = {"NPFG_PERIOD": 6.21} if px4 else {"NAVL1_PERIOD": 12.5}
    path = tmp_path / "new.params"
    path.write_text(new_text(changes, ["from a log"], px4=px4))
    assert dict(flown_now(path, "1.15").law.parameters) == changes
