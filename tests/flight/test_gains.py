"""What gains cannot be tuned for."""

import pytest

import flighttune as ft


@pytest.mark.parametrize(
    ("options", "changes", "said"),
    [
        ({"envelope": True}, {"tuning.objective": "cost"}, "`objective` of .* must be R_K over"),
        ({"envelope": True, "lag": (0.1, 0.2)}, {}, "`lag` must be absent over an envelope"),
        ({"lag": (0.1, 0.2)}, {"tuning.objective": "cost"}, "`lag` must be absent"),
        ({"starts": 0}, {}, "`starts` must be"),
    ],
)
def test_what_gains_cannot_be_tuned_for_is_refused(options, changes, said):
    with pytest.raises(ft.InputError, match=said):
        ft.tune("paper", changes=changes, **options)
