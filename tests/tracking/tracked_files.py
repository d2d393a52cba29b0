"""Files as other tracking programs write them, and short ways to read them."""

import pandas as pd
from rock2d_tracking.camera import PixelMap
from rock2d_tracking.importing import ImportOptions, TrackedFiles, import_tracks

SCALE = {"metres_per_unit": 1.0, "y": "up", "fps": 1000.0}

TRACKER = """\
,mass A,,,
t,frame,x,y,
0.000000E0,1.200000E2,-3.500000E0,4.250000E0,
3.333333E-2,1.210000E2,-3.000000E0,4.500000E0,
6.666667E-2,1.220000E2,,,
1.000000E-1,1.230000E2,-2.000000E0,5.000000E0,
"""
MULTI = """\
#multi:
\tA\t\t\tB\t\t\t
t\tframe\tx\ty\tframe\tx\ty\t
0.0\t0\t1.0\t2.0\t0\t2.0\t2.0\t
0.1\t1\t1.0\t2.0\t1\t1.0\t3.0\t
0.2\t2\t1.0\t2.0\t\t\t\t
0.3\t3\t1.0\t2.0\t3\t0.0\t2.0\t
0.4\t4\t1.0\t2.0\t4\t1.0\t1.0\t
0.5\t5\t1.0\t2.0\t5\t2.0\t2.0\t
"""
KINOVEA_TEXT = """\
#Kinovea Trajectory data export
#T X Y

# ball
0.000 77,20 -21,97\x20
0.033 72,19 -25,96\x20
0.067 68,20 -29,94\x20

# red mark
0.033 70,00 -25,00\x20
"""
KINOVEA_CSV = """\
"Time","ball/0/X","ball/0/Y","red mark/0/X","red mark/0/Y"
"0","77.20","-21.97",,
"0.033","72.19","-25.96","70.00","-25.00"
"0.067","68.20","-29.94",,
"""
DLTDV = """\
pt1_cam1_X,pt1_cam1_Y,pt2_cam1_X,pt2_cam1_Y
NaN,NaN,NaN,NaN
100.500000,200.250000,110.500000,200.250000
101.500000,199.250000,NaN,NaN
102.500000,198.250000,112.500000,208.250000
"""
SPARSE = """\
pt1_cam1_X\tpt1_cam1_Y\tpt2_cam1_X\tpt2_cam1_Y
4\t4\t10
2\t1\t100.500000
3\t1\t101.500000
4\t1\t102.500000
2\t2\t200.250000
3\t2\t199.250000
4\t2\t198.250000
2\t3\t110.500000
4\t3\t112.500000
2\t4\t200.250000
4\t4\t208.250000
"""
DEEPLABCUT = """\
scorer,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50,DLC_resnet50
bodyparts,centre,centre,centre,edge,edge,edge
coords,x,y,likelihood,x,y,likelihood
0,10.0,20.0,0.99,11.0,20.0,0.98
1,10.5,21.0,0.40,11.5,21.0,0.97
2,11.0,22.0,0.60,12.0,22.0,0.95
3,11.5,23.0,0.99,12.5,23.0,0.02
"""
FILES = {"tracker": TRACKER, "kinovea": KINOVEA_TEXT, "dltdv": DLTDV, "deeplabcut": DEEPLABCUT}


def values(points, track):
    table = points.table
    return table.loc[table["track"] == track, ["u", "v"]].to_numpy().tolist()


def imported(
    path, kind, *, block, metres_per_unit, fps, y, origin=(0.0, 0.0), origin_m=(0.0, 0.0), report=print, **options
) -> pd.DataFrame:
    """`import_tracks` of one file or several films, with its records made from flat names."""
    paths = path if isinstance(path, list) else [path]
    camera = PixelMap(metres_per_unit, origin, origin_m, up=1 if y == "up" else -1)
    files = TrackedFiles(paths, kind, y)
    return import_tracks(files, camera, fps, block, ImportOptions(**options), report=report)
