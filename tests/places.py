"""Where shipped files are in the repository."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
SHIPPED_AIRCRAFT = ROOT / "aircraft"
SHIPPED_SCENARIOS = ROOT / "scenarios"
SCENARIO_NAMES = sorted(path.stem for path in SHIPPED_SCENARIOS.glob("*.toml"))
CAMPAIGN_NAMES = sorted(path.stem for path in (SHIPPED_SCENARIOS / "campaigns").glob("*.toml"))
