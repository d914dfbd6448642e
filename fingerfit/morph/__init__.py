"""From the mesh of a reference body to that of a subject: registration, repair, accuracy."""
