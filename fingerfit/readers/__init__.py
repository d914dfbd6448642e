"""Files of other programs, read as arrays: displacements of points, records of testing machines, DICOM."""
