"""Arrays in files: what is read of them, and what is not."""

import io
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pytest

import flighttune as ft


class Trap:
    """Makes a file where it is read from a pickle."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.touch, (self.mark,)


@pytest.mark.parametrize("name", ["claim.npy", "extremes.npy"])
def test_an_array_that_is_a_pickle_is_not_read(tmp_path, name):
    mark, file, array = tmp_path / "ran", tmp_path / "band.npz", io.BytesIO()
    np.lib.format.write_array(array, np.array([Trap(mark)], dtype=object))
    with zipfile.ZipFile(file, "w") as archive:
        members = {"claim.npy": _array('{"format": "flighttune band 1"}'), name: array.getvalue()}
        for member, data in members.items():
            archive.writestr(member, data)

    with pytest.raises(ft.InputError, match=r"band\.npz"):
        ft.load(file)

    assert not mark.exists()
    pickle.loads(pickle.dumps(Trap(mark)))
    assert mark.exists()


def _array(text):
    data = io.BytesIO()
    np.lib.format.write_array(data, np.array(text))
    return data.getvalue()
