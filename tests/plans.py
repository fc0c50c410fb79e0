"""Plans of QGroundControl for tests."""

import json

import numpy as np

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

# Slope of the ground to the north, m for a degree of latitude, which interpolation has exactly.
SLOPE = 5000.0


def ground(lat):
    return HOME[2] + SLOPE * (lat - HOME[0])


def terrain(path, *, lost=None, units=None, **profile):
    """A plane that rises to the north, with posts every 0.001 deg; `lost` has no height."""
    import rasterio  # an extra

    north, west, step, size = 47.43, 8.48, 0.001, (50, 60)
    heights = np.tile(ground(north - step * (np.arange(size[0])[:, None] + 0.5)), (1, size[1]))
    if lost is not None:
        heights[lost] = -9999.0
    made = {"driver": "GTiff", "count": 1, "dtype": "float64", "crs": "EPSG:4326", "nodata": -9999}
    made |= {"height": size[0], "width": size[1], **profile}
    made["transform"] = rasterio.Affine(step, 0.0, west, 0.0, -step, north)
    with rasterio.open(path, "w", **made) as file:
        file.write(heights, 1)
        file.units = (units,) * file.count
    return path
