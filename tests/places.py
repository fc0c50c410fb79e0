"""Where shipped files are in the repository."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SHIPPED_AIRCRAFT = ROOT / "aircraft"
SHIPPED_SCENARIOS = ROOT / "scenarios"
AIRCRAFT_NAMES = sorted(path.parent.name for path in SHIPPED_AIRCRAFT.glob("*/aircraft.toml"))
STUDIES = SHIPPED_SCENARIOS / "studies"
LISTED_NAMES = sorted(path.stem for path in SHIPPED_SCENARIOS.glob("*.toml"))
SCENARIO_NAMES = sorted(LISTED_NAMES + [path.stem for path in STUDIES.glob("*.toml")])
CAMPAIGN_NAMES = sorted(path.stem for path in (SHIPPED_SCENARIOS / "campaigns").glob("*.toml"))
