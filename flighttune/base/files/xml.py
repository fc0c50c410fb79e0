"""Elements of XML, made in one expression."""

from xml.etree.ElementTree import Element


def node(tag: str, *inside: Element | str, **attributes: str) -> Element:
    """An element with a text, or with other elements in it."""
    element = Element(tag, attributes)
    for part in inside:
        if isinstance(part, str):
            element.text = part
        else:
            element.append(part)
    return element
