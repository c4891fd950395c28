//! Neural social force: networks that set the parameters of the physics, and the roll-out.
