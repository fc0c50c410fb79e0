"""Certificates as JSON files."""

from pathlib import Path

from flighttune.certificates.certificate import Certificate
from flighttune.value_file import read, write


def save_certificate(certificate: Certificate, path: str | Path) -> None:
    """Write a certificate as JSON, under a temporary name until it is whole.

    Parameters
    ----------
    certificate : Certificate
    path : path-like
        File to write or replace; its folder is made where there is none.

    Raises
    ------
    OutputError
        If the file cannot be written.
    """
    write(certificate, path)


def load_certificate(path: str | Path) -> Certificate:
    """Read a certificate; nothing in it is trusted before `verify` has checked it.

    Raises
    ------
    InputError
        If the file cannot be read or is not a certificate; the message names file and key.
    """
    return read(path, Certificate)
