"""The verdict on flights against their requirements, in words."""

from flighttune.flight.flown import ClaimCheck


def short(claim: ClaimCheck) -> str:
    """The verdict with the numbers of met, missed and unflown requirements."""
    n, met, not_flown, ended, strayed = claim.total
    runs = len(claim.counts)
    early = f"{ended} of {runs} run{'s' * (runs > 1)} ended early" if ended else ""
    if claim.verdict == "not tested":
        ends = early or f"{runs} of {runs} run{'s' * (runs > 1)} completed"
        return f"No requirement ([[expect]]) applies to these runs; {ends}"
    stated = f"{n} requirement{'s' if n > 1 else ''}"
    if claim.verdict == "met":
        poor = len(claim.lower)
        asks = f"; {poor} ask{'s' * (poor == 1)} for a slow or poor flight"
        return f"{met} of {stated} met{asks * (poor > 0)}"
    words = f"{met} of {stated} met, {n - met - not_flown} missed"
    words += f", {not_flown} not flown" if not_flown else ""
    off = f"{strayed} of {runs} run{'s' * (runs > 1)} did not follow the reference to the end"
    return "; ".join(filter(None, [words, early, off if strayed else ""]))


def closest(claim: ClaimCheck) -> str:
    """The bound with the smallest margin, of a met claim."""
    if claim.verdict != "met" or not claim.bounds:
        return ""
    tightest = max(claim.bounds, key=lambda check: check.margin)
    return f"Tightest: {tightest.run}: {tightest.sentence}"


def sentence(claim: ClaimCheck) -> str:
    """The verdict with the first missed requirement or tightest bound, and active limits."""
    first = claim.missed[:1] or [closest(claim)]
    return ". ".join(filter(None, [short(claim), *first, *claim.held[:1]]))
