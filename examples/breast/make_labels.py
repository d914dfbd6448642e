"""A breast of ellipsoids as a segmentation of one would be: fat 1, gland 2, a stiffer lump 3, a pad on top 4.

With the word `other` it is that of another subject: 15 % longer in x, 10 % narrower in y, 10 % higher, and leaning.
"""

import sys

import numpy as np
import SimpleITK as sitk

SPACING = 2.0
OTHER = "other" in sys.argv[2:]
z, y, x = np.meshgrid(*[np.arange(n) * SPACING for n in ((34, 48, 62) if OTHER else (30, 48, 48))], indexing="ij")
if OTHER:  # where its voxels are in the first subject
    z, y, x = 3 + (z - 3) / 1.1, 47 + (y - 47) / 0.9, 47 + (x - 55 - 0.004 * (z - 3) ** 2) / 1.15


def ellipsoid(centre, radii):
    """Voxels within an ellipsoid."""
    return sum(((one - c) / r) ** 2 for one, c, r in zip((x, y, z), centre, radii, strict=True)) < 1


labels = np.zeros(z.shape, np.uint8)
labels[ellipsoid((47, 47, 2), (40, 40, 52)) & (z > 3)] = 1
labels[ellipsoid((47, 47, 20), (24, 24, 16))] = 2
labels[ellipsoid((55, 47, 23), (14, 14, 11))] = 3
labels[(labels > 0) & (z > 42)] = 4
image = sitk.GetImageFromArray(labels)
image.SetSpacing([SPACING] * 3)
sitk.WriteImage(image, sys.argv[1])
