"""Tables as they are printed where nobody watches."""

from flighttune.cli.show import print_table


def test_a_name_or_a_column_of_numbers_is_never_cut(capsys):
    name, numbers = "x" * 70, "12.34 (11.22 to 13.44), 55.66 (44.33 to 66.77), 88 (77 to 99)"

    print_table("wide", ("name", "numbers of some kind", "words"), [(name, numbers, "a few words")])

    shown = capsys.readouterr().out
    assert name in shown
    assert numbers in shown
    assert "numbers of some kind" in shown
    assert "…" not in shown


def test_words_are_wrapped_to_the_width(capsys):
    print_table("long", ("name", "words"), [("x", "word " * 60)])

    assert max(map(len, capsys.readouterr().out.splitlines())) <= 132
