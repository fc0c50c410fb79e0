"""Python files that may run: those that a scenario names, or any, as the outermost verb says."""

from contextvars import copy_context

import pytest

import flighttune as ft
from flighttune.base.files import code


@pytest.fixture
def file(tmp_path):
    (tmp_path / "law.py").write_text(f"VALUE = 3  # {tmp_path}\n")
    return tmp_path / "law.py"


def asked(file, stated=None):
    return copy_context().run(code.ask, str(file), stated, "[[law]]")


def test_no_code_runs_outside_of_a_verb_that_flies(file):
    code.named_sha256(file, "[[law]]")
    with pytest.raises(ft.ScenarioError, match="--run-code"):
        asked(file)
    with code.running(code.Runs.NONE), pytest.raises(ft.ScenarioError, match="--run-code"):
        asked(file)


def test_a_file_runs_that_is_named_and_another_only_with_leave(file):
    with code.running(code.Runs.NAMED):
        with pytest.raises(ft.ScenarioError, match="--run-code"):
            asked(file)
        digest = code.named_sha256(file, "[[law]]")
        assert asked(file) == asked(file, digest) == file.read_bytes()
        with pytest.raises(ft.ScenarioError, match="--run-code"):
            asked(file, "0" * 64)
        file.write_text(file.read_text() + "# changed\n")
        with pytest.raises(ft.ScenarioError, match="other contents now"):
            asked(file, digest)
        with code.running(code.Runs.ANY), pytest.raises(ft.ScenarioError, match="--run-code"):
            asked(file)  # the block around it has decided


def test_with_leave_any_file_runs_that_is_as_it_was_planned(file, tmp_path):
    with code.running(code.Runs.ANY):
        with pytest.raises(ft.ScenarioError, match="other contents now"):
            asked(file, "0" * 64)
        with pytest.raises(ft.ScenarioError, match="other contents now"):
            asked(file)  # nobody has named it
        with pytest.raises(ft.ScenarioError, match="must be a file"):
            asked(tmp_path / "none.py")
        code.named_sha256(file, "[[law]]")
        assert asked(file) == file.read_bytes()
        assert code.run(str(file), asked(file)).VALUE == 3


def test_a_notice_names_each_file_that_is_about_to_run(file):
    told = []
    token = code.NOTICE.set(told.append)
    try:
        with code.running(code.Runs.NAMED):
            code.named_sha256(file, "[[law]]")
            asked(file)
    finally:
        code.NOTICE.reset(token)
    assert told == [str(file)]


def test_a_verb_decides_for_what_it_calls_and_leave_is_asked_of_it_alone():
    @code.flies
    def flies(*, run_code=False):
        return code.grant().runs, code.jsbsim_flies()

    @code.flies_again
    def again(*, run_code=False):
        return code.grant().runs, code.jsbsim_flies(), flies(run_code=True)[0]

    def here():
        assert code.grant().runs is code.Runs.NONE
        assert flies() == (code.Runs.NAMED, False)
        assert flies(run_code=True) == (code.Runs.ANY, False)
        assert again() == (code.Runs.NONE, True, code.Runs.NONE)
        assert again(run_code=True) == (code.Runs.ANY, True, code.Runs.ANY)
        assert not code.jsbsim_flies()

    copy_context().run(here)


def test_another_process_takes_over_what_this_one_may_do(file):
    digest = code.named_sha256(file, "[[law]]")
    with code.running(code.Runs.ANY), code.in_jsbsim():
        granted = code.grant()
    assert digest in granted.named

    def there():
        code.take(granted)
        assert code.grant()[::2] == (code.Runs.ANY, True)
        with code.running(code.Runs.NONE):
            assert code.grant().runs is code.Runs.ANY

    copy_context().run(there)
