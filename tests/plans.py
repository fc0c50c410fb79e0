"""Plans of QGroundControl for tests."""

import json

HOME = (47.4, 8.5, 480.0)


def item(command, *params, frame=3):
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": list(params)}


def waypoint(lat, lon, height, frame=3):
    return item(16, 0, 0, 0, None, lat, lon, height, frame=frame)


def plan_file(path, *items, home=HOME, **tables):
    mission = {"plannedHomePosition": home and list(home), "items": list(items)}
    path.write_text(json.dumps({"fileType": "Plan", "version": 1, "mission": mission, **tables}))
    return path


PATROL = (
    waypoint(47.4, 8.5, 60),
    waypoint(47.41, 8.5, 60),
    item(18, 2, 0, -180, 1, 47.41, 8.52, 90),
    waypoint(47.4, 8.52, 570, frame=0),
)
