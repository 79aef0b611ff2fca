//! Crowd models: ORCA, social force and learned pedestrians behind one trait.
