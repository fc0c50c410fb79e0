"""XML: elements made in one expression, and files of models with the parts that they name."""

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from flighttune.base.errors import PlantError
from flighttune.base.files.budget import XML, file_bytes

# Elements by which JSBSim opens files and sockets on its first evaluation.
CONNECTIONS = ("output", "input")


def node(tag: str, *inside: Element | str, **attributes: str) -> Element:
    """An element with a text, or with other elements in it."""
    element = Element(tag, attributes)
    for part in inside:
        if isinstance(part, str):
            element.text = part
        else:
            element.append(part)
    return element


def read_xml(file: Path, subject: str) -> Element:
    """Return the root element of `file`; `subject` begins the message of a PlantError."""
    about = subject if subject == str(file) else f"{subject}: {file}"
    try:
        data = file_bytes(file, XML, PlantError)
    except PlantError as error:
        raise PlantError(f"{about}: {str(error).removeprefix(f'{file}: ')}") from error
    if data.count(b"<") > XML.entries:
        raise PlantError(f"{about} must have at most {XML.entries} elements, got more.")
    try:
        root = ElementTree.fromstring(data)  # which refuses entities that grow
    except (ElementTree.ParseError, LookupError) as error:  # an encoding that is not known
        raise PlantError(f"{about}: must be XML: {error}.") from error
    level = [root]
    for _ in range(XML.depth):
        level = [part for element in level for part in element]
    if level:
        raise PlantError(f"{about} has too many elements inside each other.")
    if "{{" in ElementTree.tostring(root, encoding="unicode"):
        raise PlantError(f"{about} must not hold two braces: they stand for our numbers.")
    return root


def found_file(name: str, folders: Sequence[Path], named_in: Path) -> Path:
    """The file that JSBSim finds under a name; in the first folder if there is none."""
    file = name if name.endswith(".xml") else f"{name}.xml"
    # `Path.exists` raises an error for a name that is too long.
    files = (folder / file for folder in folders if os.path.exists(folder / file))
    path = next(files, folders[0] / file)
    if os.path.exists(path) and not os.path.isfile(path):  # JSBSim would wait for a pipe
        raise PlantError(f"{named_in}: `file` must name a file, got {path}.")
    # A foreign file must not refer outside its folder, by path or symlink.
    for place in (Path(os.path.normpath(path)), Path(os.path.realpath(path))):
        if not any(place.is_relative_to(folder) for folder in folders):
            raise PlantError(
                f'{named_in}: `file` must stay in the folder of the model, got "{name}".'
            )
    return path


def parts_of(root: Element, folders: Sequence[Path], named_in: Path) -> Iterator[Path]:
    """The files that elements of a model name."""
    for element in root.iter():
        if (name := element.get("file")) and element.tag not in CONNECTIONS:
            yield found_file(name, folders, named_in)
