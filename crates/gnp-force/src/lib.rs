//! Social-force physics for vehicles: potentials, forces, integrators.
