"""From a study to what a fit reads: mesh, pictures and measurements, checked and in one frame."""
