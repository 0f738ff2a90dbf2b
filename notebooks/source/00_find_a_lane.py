"""tiny trial"""
# %% [markdown]
# # 00 Find a lane in ten minutes
#
# trial

# %%
try:
    from lanelib import notebook
except ModuleNotFoundError as missing:
    raise SystemExit(f"{missing.name} is not installed; run `make lab` in the project's folder") from None
notebook.start()

# %%
from lanelib import datasets, draw, exercises, figures
from lanelib.pictures import read_image

shipped = datasets.get("rendered")

# %% alt="a road"
figures.show(read_image(shipped.images()[0]))

# %%
def offset_of(left_x_m, right_x_m):
    """Metres right of the lane's centre."""
    # BEGIN SOLUTION
    return -(left_x_m + right_x_m) / 2
    # END SOLUTION


exercises.check_offset_of(offset_of)

# %%
import time
t=time.time()
clip = notebook.clip()
clip

# %% tags=["nbval-ignore-output"]
import ipywidgets
ipywidgets.IntSlider()

# %% tags=["nbval-ignore-output"]
notebook.play(clip.frames(0, 100), alt="drive")

# %% [markdown] tags=["answer"]
# 1. x
