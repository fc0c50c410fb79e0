"""Draw the step responses of a shipped aircraft into its folder: python docs/step_responses.py.

``flighttune design AIRCRAFT`` draws them too, with gains it makes anew.
"""

import sys

from flighttune.plants.jsbsim.aircraft import load_aircraft
from flighttune.plants.jsbsim.step_figure import draw_steps
from flighttune.plants.jsbsim.steps import check_steps

if __name__ == "__main__":
    config = load_aircraft(sys.argv[1] if len(sys.argv) > 1 else "aerosonde")
    draw_steps(config, check_steps(config), config.folder)
