"""Synthetic surfaces: photos, acceleration traces and sounds from one height field per class.

The data are made for tests and for trying the whole system without a download. They are not a
model of any real data set, and no result on them says anything about one.
"""

from tex_lightning.synthetic.dataset import write_folder
from tex_lightning.synthetic.materials import Material, make_materials

__all__ = ["Material", "make_materials", "write_folder"]
