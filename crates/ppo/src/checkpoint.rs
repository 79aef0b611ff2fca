//! Checkpoints: the whole run in one safetensors file, written in one step, read with suspicion.
//!
//! | tensors | content |
//! |---|---|
//! | `actor.*`, `critic.*`, `discriminator.state_action.*`, `discriminator.state.*` | parameters, PyTorch's names and shapes |
//! | `adam.<network>.first`, `adam.<network>.second` | Adam's moments, flat, in the order of the parameters above |
//! | `state.rooms` | the rooms, JSON as bytes: poses, episodes, observations, positions of their random streams |
//! | `population.past.<k>` | snapshots of the actor that are opponents, flat, in the order of its parameters |
//! | `state.standing` | with constrained diversity, how well each behaviour drives, JSON as bytes |
//! | `state.adam_steps` | Adam's step counts, JSON as bytes |
//!
//! The metadata holds the format, the configuration (TOML, without the keys that do not change the
//! curve), its hash, the simulator's and the network's part as JSON, seed, commit, counters, with a
//! population the policies that it was read from, with a map the hash of its content, and a
//! checksum over everything. A map's relative path starts from the checkpoint's folder. Two runs of
//! the same configuration and binary write the same bytes. The trainer's own random streams are
//! named after the update, so they need no state.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use jostle_diversity::DiscriminatorShape;
use jostle_policy::file::{CHECKPOINT_FORMAT, network_json};
use jostle_policy::{Layout, PolicyError, Provenance, TensorFile, TensorOut, Values, excerpt, write_tensors};
use jostle_sim::RoomsState;

use crate::adam::Adam;
use crate::learner::Learner;
use crate::population::Population;
use crate::ranks::{Alone, Communicator};
use crate::{Config, PpoError, Trainer};

/// Largest count of updates, transitions or steps that is believed; a run of the paper sees 3.2
/// million transitions.
const COUNT_MAX: u64 = 1 << 53;
/// The metadata that names the opponents which came from files.
const OPPONENTS: &str = "opponents";
/// Returns of each behaviour.
const STANDING: &str = "state.standing";
/// Metadata: the hash of the map's content.
const MAP: &str = "map_sha256";
/// The hashes of the training crowd's maps, a JSON list.
const TRAINING_MAPS: &str = "training_maps_sha256";

impl Trainer {
    /// Writes the run to `path`. A file that was there is replaced whole or not at all, and kept as
    /// [`previous_path`]. Of several ranks, which all have to call this, the first one writes.
    ///
    /// # Errors
    ///
    /// [`PpoError::Policy`] when the disk refuses or a parameter is not finite, [`PpoError::Io`]
    /// when the earlier file cannot be kept; the earlier file is then still in its place.
    pub fn save(&mut self, path: &Path) -> Result<(), PpoError> {
        let written = match self.rooms_state()? {
            Some(rooms) => self.write(path, &rooms),
            None => Ok(()),
        };
        self.ranks.agree(written)
    }

    /// The state of all rooms, on the first rank.
    fn rooms_state(&self) -> Result<Option<RoomsState>, PpoError> {
        let own = RoomsState::join(self.shards.iter().map(|shard| shard.rooms.state()));
        let own = own.expect("every rank has a shard");
        if !self.ranks.are_several() {
            return Ok(Some(own));
        }
        let all =
            self.ranks.collect(&serde_json::to_vec(&own).expect("the rooms' state is plain numbers"))?;
        let others = all.iter().map(|part| {
            serde_json::from_slice(part).map_err(|error| PpoError::Ranks { reason: error.to_string() })
        });
        Ok(RoomsState::join(others.collect::<Result<Vec<_>, _>>()?))
    }

    fn write(&mut self, path: &Path, rooms: &RoomsState) -> Result<(), PpoError> {
        let metadata = self.metadata(path.parent().unwrap_or(Path::new("")));
        let rooms = serde_json::to_vec(rooms).expect("the rooms' state is plain numbers");
        let steps: BTreeMap<&str, u64> =
            self.learners().into_iter().map(|learner| (learner.name(), learner.adam.steps())).collect();
        let steps = serde_json::to_vec(&steps).expect("step counts are plain numbers");
        let saved: Vec<_> = self.learners().into_iter().map(SavedLearner::new).collect();
        let mut tensors: Vec<TensorOut<'_>> = saved.iter().flat_map(SavedLearner::tensors).collect();
        let standing = self
            .standing
            .as_ref()
            .map(|standing| serde_json::to_vec(standing).expect("means and counts are plain numbers"));
        let states = [
            ("state.rooms", Some(&rooms)),
            ("state.adam_steps", Some(&steps)),
            (STANDING, standing.as_ref()),
        ];
        for (name, bytes) in states.into_iter().filter_map(|(name, bytes)| Some((name, bytes?))) {
            tensors.push(TensorOut {
                name: name.to_owned(),
                shape: vec![bytes.len()],
                values: Values::U8(bytes),
            });
        }
        let snapshots = self.population.as_mut().map_or_else(Vec::new, Population::snapshots);
        for (name, values) in &snapshots {
            let (name, shape) = (name.clone(), vec![values.len()]);
            tensors.push(TensorOut { name, shape, values: Values::F32(values) });
        }
        keep_previous(path)?;
        Ok(write_tensors(path, &tensors, &metadata)?)
    }

    /// Goes on from a checkpoint, with the configuration that it holds.
    ///
    /// `updates`, `checkpoint_every` and `threads` are not part of a checkpoint and come back as
    /// defaults; give them by [`Self::resume_with`].
    ///
    /// # Errors
    ///
    /// [`PpoError::Policy`] or [`PpoError::Checkpoint`] for a file that is missing, truncated,
    /// damaged, of another format or of another shape than its own configuration says.
    pub fn resume(path: &Path) -> Result<Self, PpoError> {
        let file = open(path)?;
        let config = stored_config(&file)?;
        Self::restore(config, &file, Arc::new(Alone))
    }

    /// Goes on from a checkpoint of the run that `config` describes.
    ///
    /// # Errors
    ///
    /// As [`Self::resume`], and [`PpoError::Checkpoint`] when the checkpoint belongs to another
    /// configuration.
    pub fn resume_with(path: &Path, config: Config) -> Result<Self, PpoError> {
        Self::resume_among(path, config, Arc::new(Alone))
    }

    /// As [`Self::resume_with`], as one of the processes of a run: there may be more or fewer than
    /// have made the checkpoint.
    ///
    /// # Errors
    ///
    /// As [`Self::resume_with`], and [`PpoError::Ranks`] when the shards cannot be dealt to so many
    /// ranks.
    pub fn resume_among(path: &Path, config: Config, ranks: Arc<dyn Communicator>) -> Result<Self, PpoError> {
        let file = open(path)?;
        let (found, expected) = (stored_config(&file)?.hash(), config.hash());
        if found != expected {
            let found = format!("the checkpoint of another configuration ({found})");
            return Err(refuse(path, "config_hash", found, expected));
        }
        Self::restore(config, &file, ranks)
    }

    fn restore(config: Config, file: &TensorFile, ranks: Arc<dyn Communicator>) -> Result<Self, PpoError> {
        let provenance = Provenance::read(file)?;
        let stored = stored_config(file)?;
        if ![stored.hash(), stored.hash_with_path()].contains(&provenance.config_hash) {
            return Err(refuse(file.path(), "config_hash", provenance.config_hash, stored.hash()));
        }
        // Before anything of the configuration's sizes is made: a file that claims much must hold
        // as much.
        check_shapes(&config, file)?;
        for (field, found) in [("update", provenance.update), ("transitions", provenance.transitions)] {
            check_count(file, field, found)?;
        }
        let mut trainer = Self::among(config, ranks)?;
        if let (Some(found), Some(expected)) = (&trainer.map_sha256, file.metadata().get(MAP))
            && found != expected
        {
            let found = format!("another content in {} ({found})", shown_map(&trainer.config));
            return Err(refuse(file.path(), MAP, found, format!("the map of the run ({expected})")));
        }
        trainer.check_training_maps(file)?;
        let steps: BTreeMap<String, u64> = json(file, "state.adam_steps")?;
        for learner in trainer.learners() {
            learner.restore(file, &steps)?;
        }
        trainer.restore_population(file)?;
        if let Some(standing) = &mut trainer.standing {
            let expected = standing.len();
            *standing = json(file, STANDING)?;
            if standing.len() != expected || !standing.is_sound() {
                let found = format!("the state of {} behaviours", standing.len());
                return Err(refuse(
                    file.path(),
                    STANDING,
                    found,
                    format!("finite means and a count of {expected}"),
                ));
            }
        }
        let rooms: RoomsState = json(file, "state.rooms")?;
        let parts = rooms.split(trainer.config.shards)?;
        for (shard, part) in
            trainer.shards.iter_mut().zip(parts.into_iter().skip(trainer.ranks.own_shards().start))
        {
            shard.rooms.restore(part)?;
        }
        trainer.commit = provenance.commit;
        (trainer.update, trainer.transitions) = (provenance.update, provenance.transitions);
        Ok(trainer)
    }

    /// Refuses to go on in other maps than those that the run began in.
    fn check_training_maps(&self, file: &TensorFile) -> Result<(), PpoError> {
        let Some(stored) = file.metadata().get(TRAINING_MAPS) else { return Ok(()) };
        let expected: Vec<String> = serde_json::from_str(stored).map_err(|error| {
            refuse(file.path(), TRAINING_MAPS, error.to_string(), "a list of hashes".to_owned())
        })?;
        if self.training_maps.len() != expected.len() {
            let (found, expected) = (self.training_maps.len(), expected.len());
            return Err(refuse(
                file.path(),
                TRAINING_MAPS,
                format!("{found} maps"),
                format!("{expected} of the run"),
            ));
        }
        let maps = self.config.training_crowd.map_files();
        let differs = (0..expected.len()).find(|i| self.training_maps[*i] != expected[*i]);
        differs.map_or(Ok(()), |i| {
            let found = format!("another content in {} ({})", maps[i].display(), self.training_maps[i]);
            let expected = format!("the map of the run ({})", expected[i]);
            Err(refuse(file.path(), TRAINING_MAPS, found, expected))
        })
    }

    /// The metadata of a file in `folder`.
    fn metadata(&self, folder: &Path) -> BTreeMap<String, String> {
        let config = self.config.as_named_in(folder);
        let network = network_json(&config.network_config());
        let sim = serde_json::to_string(&config.sim).expect("the simulator's configuration is plain data");
        let fields = [
            ("format", CHECKPOINT_FORMAT.to_owned()),
            ("config", config.canonical_toml()),
            ("sim", sim),
            ("network", network),
        ];
        let mut metadata: BTreeMap<_, _> = fields.map(|(key, value)| (key.to_owned(), value)).into();
        metadata.extend(self.map_sha256.clone().map(|hash| (MAP.to_owned(), hash)));
        if !self.training_maps.is_empty() {
            let hashes = serde_json::to_string(&self.training_maps).expect("texts are always JSON");
            metadata.insert(TRAINING_MAPS.to_owned(), hashes);
        }
        self.provenance().write(&mut metadata);
        metadata.extend(self.opponents_json().map(|json| (OPPONENTS.to_owned(), json)));
        metadata
    }

    /// The identities of the opponents of the population's files; `None` without a population.
    fn opponents_json(&self) -> Option<String> {
        let population = self.population.as_ref()?;
        Some(serde_json::to_string(population.records()).expect("records are plain data"))
    }

    fn restore_population(&mut self, file: &TensorFile) -> Result<(), PpoError> {
        let expected = self.opponents_json();
        let Some(population) = &mut self.population else { return Ok(()) };
        let (found, expected) = (file.metadata_value(OPPONENTS)?, expected.unwrap_or_default());
        if found != expected {
            let found = format!("opponents {found}");
            return Err(refuse(
                file.path(),
                "metadata opponents",
                found,
                format!("those of population.files, {expected}"),
            ));
        }
        population.restore(|name, len| Ok(file.f32s(name, &[len])?))
    }

    /// The policy's origin, as checkpoints and reports state it.
    pub fn provenance(&self) -> Provenance {
        Provenance {
            config_hash: self.config.hash(),
            seed: self.config.seed,
            commit: self.commit.clone(),
            update: self.update,
            transitions: self.transitions,
            n_agents: self.config.n_agents as u64,
            n_rooms: self.config.n_rooms as u64,
        }
    }

    fn learners(&mut self) -> [&mut Learner; 4] {
        [&mut self.actor, &mut self.critic, &mut self.q_state_action, &mut self.q_state]
    }
}

/// Path of the checkpoint before the one at `path`: `.previous` behind the name.
pub fn previous_path(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".previous");
    name.into()
}

/// Reads the configuration of a checkpoint.
///
/// # Errors
///
/// As [`Trainer::resume`].
pub fn read_config(path: &Path) -> Result<Config, PpoError> {
    stored_config(&open(path)?)
}

/// Keeps the file at `path` under a second name; at no moment is there no good file.
fn keep_previous(path: &Path) -> Result<(), PpoError> {
    if !path.exists() {
        return Ok(());
    }
    let previous = previous_path(path);
    let io = |reason| PpoError::Io { path: previous.clone(), action: "keep the previous checkpoint", reason };
    let mut link = previous.as_os_str().to_owned();
    link.push(".partial");
    let link = PathBuf::from(link);
    // A leftover of a killed process.
    let _ = std::fs::remove_file(&link);
    // Not every file system has hard links; a copy does as well.
    std::fs::hard_link(path, &link).or_else(|_| std::fs::copy(path, &link).map(drop)).map_err(io)?;
    std::fs::rename(&link, &previous).map_err(io)?;
    // Where both are already the same file, as after a kill between this and the replacement,
    // renaming does nothing.
    let _ = std::fs::remove_file(&link);
    Ok(())
}

fn open(path: &Path) -> Result<TensorFile, PpoError> {
    let file = TensorFile::read(path)?;
    let format = file.metadata_value("format")?;
    if format != CHECKPOINT_FORMAT {
        return Err(refuse(path, "metadata format", format.to_owned(), CHECKPOINT_FORMAT.to_owned()));
    }
    file.verify_checksum()?;
    Ok(file)
}

fn stored_config(file: &TensorFile) -> Result<Config, PpoError> {
    let label = format!("{} (metadata config)", file.path().display());
    let mut config = Config::parse(file.metadata_value("config")?, &label, &[] as &[&str])?;
    config.stored_in(file.path().parent().unwrap_or(Path::new("")));
    Ok(config)
}

fn shown_map(config: &Config) -> String {
    config.sim.room.map_file().map_or_else(String::new, |map| map.display().to_string())
}

fn json<T: serde::de::DeserializeOwned>(file: &TensorFile, name: &str) -> Result<T, PpoError> {
    let (_, bytes) = file.raw(name)?;
    serde_json::from_slice(bytes)
        .map_err(|error| refuse(file.path(), name, error.to_string(), "JSON of this state".to_owned()))
}

fn refuse(path: &Path, field: &str, found: impl Into<String>, expected: String) -> PpoError {
    let (field, found) = (excerpt(field), excerpt(&found.into()));
    PpoError::Checkpoint { path: path.to_path_buf(), field, found, expected }
}

/// Refuses a file whose tensors are not of the shapes that the configuration asks for.
fn check_shapes(config: &Config, file: &TensorFile) -> Result<(), PpoError> {
    let network = config.network_config();
    let (hidden, n_behaviours) = (config.discriminator.hidden, config.n_behaviours);
    let q = |n_inputs| DiscriminatorShape { n_inputs, hidden, n_behaviours }.layout();
    let width = network.input_len();
    let layouts = [
        ("actor", Layout::actor(&network)),
        ("critic", Layout::critic(&network)),
        ("discriminator.state_action", q(width + 2)),
        ("discriminator.state", q(width)),
    ];
    for (network, layout) in layouts {
        for entry in layout.entries() {
            let name = format!("{network}.{}", entry.name);
            let shape = file.shape(&name)?;
            if shape != entry.shape {
                let expected = format!("shape {:?}", entry.shape);
                return Err(refuse(file.path(), &name, format!("shape {shape:?}"), expected));
            }
        }
    }
    Ok(())
}

/// Refuses a count that could not go on.
fn check_count(file: &TensorFile, field: &str, found: u64) -> Result<(), PpoError> {
    if found <= COUNT_MAX {
        return Ok(());
    }
    Err(refuse(file.path(), field, found.to_string(), format!("at most {COUNT_MAX}")))
}

/// A learner in canonical order.
struct SavedLearner {
    name: &'static str,
    layout: Layout,
    parameters: Vec<f32>,
    moments: [Vec<f32>; 2],
}

impl SavedLearner {
    fn new(learner: &mut Learner) -> Self {
        let canonical = |moments: &[f32]| learner.network.to_canonical(moments);
        let moments = [canonical(learner.adam.first_moments()), canonical(learner.adam.second_moments())];
        Self {
            name: learner.name(),
            layout: learner.layout().clone(),
            parameters: learner.parameters(),
            moments,
        }
    }

    fn tensors(&self) -> Vec<TensorOut<'_>> {
        let mut tensors = TensorOut::all(self.name, &self.layout, &self.parameters);
        for (which, moments) in ["first", "second"].iter().zip(&self.moments) {
            let name = format!("adam.{}.{which}", self.name);
            tensors.push(TensorOut { name, shape: vec![moments.len()], values: Values::F32(moments) });
        }
        tensors
    }
}

impl Learner {
    /// Takes parameters, moments and step count from a checkpoint.
    fn restore(&mut self, file: &TensorFile, steps: &BTreeMap<String, u64>) -> Result<(), PpoError> {
        let name = self.name();
        let parameters = file.parameters(name, self.layout().clone())?;
        let native = self.network.to_native(parameters.flat());
        self.network.parameters_and_gradient().0.copy_from_slice(&native);
        self.network.parameters_changed();
        let moments = |which: &str| -> Result<Vec<f32>, PolicyError> {
            let canonical = file.f32s(&format!("adam.{name}.{which}"), &[self.layout().len()])?;
            Ok(self.network.to_native(&canonical))
        };
        let (first, second) = (moments("first")?, moments("second")?);
        let missing =
            || refuse(file.path(), "state.adam_steps", "nothing".to_owned(), format!("{name}'s step count"));
        let taken = *steps.get(name).ok_or_else(missing)?;
        check_count(file, "state.adam_steps", taken)?;
        self.adam = Adam::resume(self.adam.learning_rate(), taken, first, second);
        Ok(())
    }
}
