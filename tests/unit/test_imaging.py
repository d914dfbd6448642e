"""Warp, similarity, pictures and noise."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage.metrics import normalized_mutual_information

from fingerfit.core.errors import InputError
from fingerfit.imaging.noise import add_rician, estimate_noise, noise_of_repeats
from fingerfit.imaging.pictures import Picture, read_picture, write_picture
from fingerfit.imaging.preprocess import smooth
from fingerfit.imaging.similarity import LIMITS, Similar, joint_histogram, nmi
from fingerfit.imaging.warp import Probe, backward_map, sample, spline_coefficients, warp
from fingerfit.mesh.blocks import brick, layered_block
from fingerfit.mesh.mesh import Block, Mesh


def grid(count, dim=2, size=14.0):
    spacing = np.full(dim, size / count)
    return Picture(np.zeros((count,) * dim), spacing, np.full(dim, -1.0) + spacing / 2, np.eye(dim))


def test_nmi_by_hand():
    a, b = np.array([[0, 0], [1, 1]]), np.array([[0, 1], [1, 1]])
    half, quarter = -np.log(0.5) * 0.5, -np.log(0.25) * 0.25
    marginal_a, marginal_b = 2 * half, quarter - 0.75 * np.log(0.75)
    joint = quarter + quarter + half
    assert nmi(a, b, bins=2, smooth=False) == pytest.approx((marginal_a + marginal_b) / joint, rel=1e-14)


def test_nmi_moves_with_each_pixel_as_its_gradient_says(rng):
    a, b = rng.uniform(0.0, 1.0, (2, 9, 7))
    b[0, :3] = -0.1, 1.2, 0.5
    found = Similar(a, b, np.ones(b.shape, dtype=bool), 8, LIMITS).gradient(b.ravel()).reshape(b.shape)
    assert found[0, 0] == found[0, 1] == 0.0
    for pixel in [(0, 2), (4, 4), (8, 6), (3, 0)]:
        step = np.zeros(b.shape)
        step[pixel] = 1e-6
        slope = (nmi(a, b + step, 8, limits=LIMITS) - nmi(a, b - step, 8, limits=LIMITS)) / 2e-6
        assert found[pixel] == pytest.approx(slope, rel=1e-5, abs=1e-9)


def test_pixels_that_stay_are_counted_once(rng):
    """Value and gradient are those of whole pictures, whichever pixels are said to stay; also where all do, or none."""
    a, b = rng.uniform(-0.1, 1.1, (2, 9, 7))
    whole = Similar(a, b, np.ones(b.shape, dtype=bool), 8, LIMITS).gradient(b.ravel()).reshape(b.shape)
    for moving in (rng.uniform(size=b.shape) < 0.4, np.zeros(b.shape, dtype=bool), np.ones(b.shape, dtype=bool)):
        found = Similar(a, b, moving, 8, LIMITS)
        assert found.gradient(b[moving]) == pytest.approx(whole[moving], rel=1e-10, abs=1e-14)
        other = b.copy()
        other[moving] = rng.uniform(size=moving.sum())
        assert found.value(other[moving]) == pytest.approx(nmi(a, other, 8, limits=LIMITS), rel=1e-12)
        sure = rng.uniform(size=b.shape)
        found = Similar(a, b, moving, 8, LIMITS, sure)
        assert found.value(other[moving]) == pytest.approx(nmi(a, a + sure * (other - a), 8, limits=LIMITS), rel=1e-12)


def test_nmi_is_that_of_scikit_image(rng):
    a = rng.normal(size=(40, 50))
    b = a + 0.5 * rng.normal(size=a.shape)
    assert nmi(a, b, 32, smooth=False) == pytest.approx(normalized_mutual_information(a, b, bins=32), rel=1e-12)


def test_smooth_histogram_follows_the_intensities(rng):
    a, b = rng.uniform(size=(30, 30)), rng.uniform(size=(30, 30))
    assert joint_histogram(a, b, 16).sum() == pytest.approx(1.0, rel=1e-12)
    slopes = [(nmi(a, b + h, 16, limits=(0, 2)) - nmi(a, b, 16, limits=(0, 2))) / h for h in (1e-6, 1e-7)]
    # a tenth of a slope's root mean square, 0.0065 (40 seeds: 1.3e-4 at most); of a histogram with steps it is 0 or 1000
    assert slopes[0] == pytest.approx(slopes[1], abs=6.5e-4)


@pytest.mark.parametrize("shape", [(20, 31), (9, 12, 15)])
def test_smoothing_is_that_of_scipy(shape, rng):
    values = rng.normal(size=shape)
    assert smooth(values, 1.3) == pytest.approx(gaussian_filter(values, 1.3), abs=1e-13)


@pytest.mark.parametrize("dim", [2, 3])
def test_an_affine_deformation_is_mapped_back_exactly(dim, rng):
    mesh = (
        layered_block(12.0, [("a", 6.0), ("b", 6.0)], 4, 2, grading=3.0) if dim == 2 else brick((12, 12, 12), (2, 3, 2))
    )
    frame = grid(40 if dim == 2 else 20, dim)
    gradient = 0.1 * rng.normal(size=(dim, dim))
    way = backward_map(mesh, mesh.points @ gradient.T, frame)
    inverse = np.linalg.inv(np.eye(dim) + gradient)
    pixels = np.stack(np.unravel_index(way.pixel, frame.values.shape)[::-1], axis=1)
    expected = frame.to_points(pixels.astype(float)) @ inverse.T
    assert frame.to_points(way.index) == pytest.approx(expected, abs=1e-9)
    everything = np.indices(frame.values.shape)[::-1].reshape(dim, -1).T
    back = frame.to_points(everything.astype(float)) @ inverse.T
    assert len(way.pixel) == ((back > -1e-9) & (back < 12 + 1e-9)).all(axis=1).sum()
    assert (way.inverted, way.overlaps) == (0, 0)


@pytest.mark.parametrize("element", ["CPE4", "CPE6", "CPE8"])
def test_no_displacement_gives_the_picture_back(element, rng):
    mesh = layered_block(12.0, [("a", 12.0)], 5, 5, element)
    frame = grid(64)
    values = rng.uniform(size=frame.values.shape)
    way = backward_map(mesh, np.zeros(mesh.points.shape), frame)
    found = warp(spline_coefficients(values), -1.0, way)
    covered = found > -1.0
    assert found[covered] == pytest.approx(values[covered], abs=1e-9)
    assert covered.sum() == len(way.pixel) == 54 * 54  # centres from 0.203 to 11.797 mm


def test_what_changes_the_brightness_changes_the_body_and_not_what_is_around_it(rng):
    mesh = layered_block(12.0, [("a", 12.0)], 5, 5, "CPE4")
    frame = grid(64)
    way = backward_map(mesh, np.zeros(mesh.points.shape), frame)
    coefficients = spline_coefficients(rng.uniform(0.5, 1.0, size=frame.values.shape))
    plain, lit = (warp(coefficients, 0.1, way, seen=seen) for seen in (None, lambda own: 1.5 * own))
    outside = np.ones(plain.size, dtype=bool)
    outside[way.pixel] = False
    assert (lit.ravel()[outside] == 0.1).all()
    assert lit.ravel()[way.pixel] == pytest.approx(1.5 * plain.ravel()[way.pixel])
    # before the pictures are smoothed, so that a border is as soft as that of the measured one
    soft = warp(coefficients, 0.1, way, 1.0, lambda own: 1.5 * own)
    assert soft == pytest.approx(smooth(lit, 1.0), abs=1e-12)


def test_inverted_and_overlapping_elements_are_reported():
    mesh = layered_block(12.0, [("a", 12.0)], 2, 2, "CPE4")
    u = np.zeros(mesh.points.shape)
    u[4] = [9.0, 0.0]  # the middle node pushed out at the side
    way = backward_map(mesh, u, grid(60))
    assert way.inverted == 2
    assert way.overlaps > 10
    assert way.folded


def test_an_overlap_that_is_no_deeper_than_a_pixel_is_no_fold():
    """Two halves of a block, pushed into each other: a pixel more or less of an overlap may be rounding of its border."""
    left = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 12.0], [0.0, 12.0]])
    points = np.vstack([left, left + np.array([6.0, 0.0])])
    split = Mesh(points, (Block("CPE4", np.arange(8).reshape(2, 4)),), {}, {})
    frame, u = grid(60), np.zeros(points.shape)
    for pixels, folded in ((1.5, False), (4.5, True)):
        u[4:, 0] = -pixels * frame.spacing[0]
        way = backward_map(split, u, frame)
        assert way.overlaps > 10
        assert way.folded is folded


def test_spline_is_exact_on_cubics():
    x = np.arange(30.0)
    coefficients = spline_coefficients(np.add.outer((x - 15) ** 3 / 100, x**2))
    at = np.array([[12.3, 14.7], [15.0, 16.2]])
    assert sample(coefficients, at) == pytest.approx((at[:, 1] - 15) ** 3 / 100 + at[:, 0] ** 2, rel=1e-4)


def test_probe_reads_quadratic_fields():
    mesh = layered_block(12.0, [("a", 12.0)], 3, 3)
    points = np.array([[1.0, 2.0], [11.3, 7.7], [13.0, 1.0]])
    found = Probe(mesh, points).read(mesh.points**2)
    assert found[:2] == pytest.approx(points[:2] ** 2, abs=1e-9)
    assert np.isnan(found[2]).all()


def test_rician_noise_is_found_again(rng):
    values = np.zeros((400, 400))
    values[60:340, 60:340] = 1.0
    noisy = add_rician(values, 0.03, rng)
    dark, inside = values == 0, noisy[70:330, 70:330]
    # 5 standard errors of a median, 1 / (2 f sqrt(n)) with f the density there: 1 / (2 ln 2) of Rayleigh's sigma for n
    # pixels, 1.17 of a normal one for the n / 4 diagonal details
    assert estimate_noise(noisy, dark) == pytest.approx(0.03, rel=5 / (2 * np.log(2)) / np.sqrt(dark.sum()))
    assert estimate_noise(inside) == pytest.approx(0.03, rel=5 * 1.17 / np.sqrt(inside.size / 4))


@pytest.mark.parametrize("level", [1.5, 2.0, 2.5, 5.0, 50.0, 1000.0])
@pytest.mark.parametrize("kind", ["normal", "cut off at 0", "Rician"])
@pytest.mark.parametrize("step", [0.0, 1.0, 14.0])
def test_the_level_of_a_background_is_not_taken_for_noise(level, kind, step, rng):
    """Of a camera, say: its black level, as whole numbers or not.

    Ten times 1.5 over the root of n: the standard error of a standard deviation is 0.7, and the level adds to it. With
    as many pixels a normal distribution is taken for a Rician one at the levels between only; there 1.07 was the most
    of 40 seeds, and else 1.023. With a fourth of them, in steps of 14, it was so at a level of 2 in one of 120.
    """
    sigma, count = 35.0, 80_000
    values = add_rician(np.full(count, level * sigma), sigma, rng)
    if kind != "Rician":
        values = rng.normal(level * sigma, sigma, count)
    values = values if kind == "normal" else np.maximum(values, 0.0)
    values = np.rint(values / step) * step if step else values
    found = estimate_noise(values.reshape(200, 400), np.ones((200, 400), dtype=bool))
    alike = kind != "Rician" and 2.0 < level < 5.0
    assert found == pytest.approx(sigma, rel=0.15 if alike else 10 * 1.5 / np.sqrt(count))


def test_a_border_that_was_set_to_0_is_not_taken_for_the_half_of_a_noise(rng):
    """As many zeros as a normal background of that spread would have, 5.6 %; the median of the others moves by 5 %."""
    values = add_rician(np.zeros(20_000), 35.0, rng)
    values[:1120] = 0.0
    assert estimate_noise(values, np.ones(20_000, dtype=bool)) == pytest.approx(35.0, rel=0.08)


def test_a_background_of_one_value_has_no_noise():
    assert estimate_noise(np.full((20, 20), 7.0), np.ones((20, 20), dtype=bool)) == 0.0


def test_texture_is_not_taken_for_noise(rng):
    """Thirty times as strong, of 2 pixels: found 1.085 times the noise, by differences alone 2.04; 0.016 from seed to seed."""
    texture = gaussian_filter(rng.normal(size=(160, 160)), 2.0)
    picture = 0.15 * texture / texture.std() + rng.normal(0.0, 0.005, texture.shape)
    assert estimate_noise(picture) == pytest.approx(0.005, rel=0.085 + 5 * 0.016)


@pytest.mark.parametrize("shape", [(30, 31), (30, 31, 32), (2, 30, 31)])
def test_slopes_are_not_taken_for_noise(shape):
    """Not their rounding either."""
    picture = sum(share * axis for share, axis in zip((0.1, 0.7, 1.3), np.indices(shape), strict=False))
    assert estimate_noise(picture) == 0.0


def test_noise_of_repeat_pictures_is_what_differs_between_them(rng):
    values = rng.uniform(0.5, 1.0, (60, 60))
    pictures = [values + rng.normal(0.0, 0.02, values.shape) for _ in range(4)]
    where = np.zeros(values.shape, dtype=bool)
    where[10:50, 10:50] = True
    # 5 standard errors of a standard deviation with 3 degrees of freedom at each pixel
    close = 5 / np.sqrt(2 * 3 * where.sum())
    assert noise_of_repeats(pictures, where) == pytest.approx(0.02, rel=close)
    pictures[1][~where] += 1.0
    assert noise_of_repeats(pictures, where) == pytest.approx(0.02, rel=close)


@pytest.mark.parametrize("name", ["a.nii.gz", "a.mha", "a.nrrd"])
def test_pictures_keep_their_place(tmp_path, name, rng):
    picture = Picture(np.rint(rng.uniform(0, 4000, (5, 7))), np.array([0.1, 0.2]), np.array([-3.0, 4.0]), np.eye(2))
    write_picture(tmp_path / name, picture)
    again = read_picture(tmp_path / name)
    assert again.same_place(picture)
    assert (again.values == picture.values).all()


def test_a_dicom_series_is_a_volume(tmp_path):
    import SimpleITK as sitk

    writer = sitk.ImageFileWriter()
    writer.KeepOriginalImageUIDOn()
    for n in range(3):
        image = sitk.GetImageFromArray(np.full((1, 4, 5), n, dtype=np.uint16))
        for tag, value in (
            ("0008|0060", "MR"),
            ("0020|000e", "1.2.3.4"),
            ("0020|000d", "1.2.3"),
            ("0020|0013", str(n)),
            ("0020|0032", f"0\\0\\{2 * n}"),
            ("0020|0037", "1\\0\\0\\0\\1\\0"),
        ):
            image.SetMetaData(tag, value)
        writer.SetFileName(str(tmp_path / f"{n}.dcm"))
        writer.Execute(image)
    picture = read_picture(tmp_path)
    assert picture.values.shape == (3, 4, 5)
    assert picture.values[:, 0, 0].tolist() == [0, 1, 2]


def test_an_empty_folder_is_no_series(tmp_path):
    with pytest.raises(InputError, match="without a DICOM series"):
        read_picture(tmp_path)


CORNERS = np.array([[3.0, 4.0], [7.0, 10.0]])


@pytest.mark.parametrize("turned", [False, True])
def test_crop_keeps_every_pixel_where_it_is(rng, turned):
    direction = np.array([[0.0, -1.0], [1.0, 0.0]]) if turned else np.eye(2)
    origin = np.array([14.0, 0.0]) if turned else np.array([0.0, 0.0])
    whole = Picture(rng.uniform(size=(60, 80)), np.array([0.25, 0.25]), origin, direction)
    part = whole.crop(CORNERS, 0.25)
    index = np.stack(np.meshgrid(*[np.arange(n) for n in part.values.shape[::-1]]), axis=-1).reshape(-1, 2)
    there = whole.to_index(part.to_points(index.astype(float)))
    assert there == pytest.approx(there.round(), abs=1e-9)
    x, y = there.round().astype(int).T
    assert np.array_equal(whole.values[y, x], part.values.ravel())
    assert np.array_equal(part.spacing, whole.spacing)
    assert np.array_equal(part.direction, whole.direction)


def test_crop_is_wider_by_a_share_of_the_extent():
    whole = Picture(np.zeros((60, 80)), np.array([0.25, 0.25]), np.zeros(2), np.eye(2))
    part = whole.crop(CORNERS, 0.25)
    low, high = part.origin, part.to_points(np.array(part.values.shape[::-1]) - 1.0)
    # 4 x 6 mm around which 1 and 1.5 mm
    assert low == pytest.approx([2.0, 2.5])
    assert high == pytest.approx([8.0, 11.5])


def test_crop_ends_at_the_border_of_the_picture():
    whole = Picture(np.zeros((60, 80)), np.array([0.25, 0.25]), np.zeros(2), np.eye(2))
    assert whole.crop(CORNERS, 50.0).same_place(whole)
    part = whole.crop(np.array([[-5.0, -5.0], [1.0, 1.0]]), 0.0)
    assert part.values.shape == (5, 5)
    assert part.origin == pytest.approx([0.0, 0.0])


def test_crop_in_space(rng):
    whole = Picture(rng.uniform(size=(6, 8, 10)), np.ones(3), np.zeros(3), np.eye(3))
    part = whole.crop(np.array([[2.0, 3.0, 1.0], [5.0, 6.0, 4.0]]), 0.0)
    assert np.array_equal(part.values, whole.values[1:5, 3:7, 2:6])
    assert part.origin == pytest.approx([2.0, 3.0, 1.0])


def test_what_a_file_cannot_hold_is_cut_off(tmp_path):
    """Noise below zero must not come back as the brightest of all pixels."""
    values = np.array([[-3.0, 0.0, 7.9], [65535.0, 65536.0, 1e9]])
    write_picture(tmp_path / "a.nii.gz", Picture(values, np.ones(2), np.zeros(2), np.eye(2)))
    assert read_picture(tmp_path / "a.nii.gz").values.tolist() == [[0, 0, 7], [65535, 65535, 65535]]
