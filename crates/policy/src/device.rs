//! The device that the reference back end computes on, by its name in a configuration.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use crate::error::PolicyError;
use crate::network::Backend;

/// `cpu`, or a GPU by its kind and number: `cuda:0`, `metal:0`.
///
/// # Examples
///
/// ```
/// use jostle_policy::Device;
/// assert_eq!("cuda:1".parse::<Device>()?, Device::Cuda(1));
/// assert_eq!(Device::default().to_string(), "cpu");
/// assert!("gpu".parse::<Device>().is_err());
/// # Ok::<(), jostle_policy::PolicyError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub enum Device {
    /// The processor: the default.
    #[default]
    Cpu,
    /// A GPU of NVIDIA's, with the feature `cuda`.
    Cuda(usize),
    /// A GPU of Apple's, with the feature `metal`.
    Metal(usize),
}

/// The devices that a configuration may name.
const NAMES: &str = "cpu, cuda:N or metal:N";

impl Device {
    /// candle's device.
    ///
    /// # Errors
    ///
    /// [`PolicyError::Config`] where this build or this machine has no such device: nothing else is
    /// taken in its place.
    pub fn open(self) -> Result<candle_core::Device, PolicyError> {
        match self {
            Self::Cpu => Ok(candle_core::Device::Cpu),
            Self::Cuda(_) if !cfg!(feature = "cuda") => Err(self.is_not_built("cuda")),
            Self::Cuda(number) => {
                candle_core::Device::new_cuda(number).map_err(|error| self.is_not_there(error))
            }
            Self::Metal(_) if !cfg!(feature = "metal") => Err(self.is_not_built("metal")),
            Self::Metal(number) => {
                candle_core::Device::new_metal(number).map_err(|error| self.is_not_there(error))
            }
        }
    }

    fn is_not_built(self, feature: &str) -> PolicyError {
        refuse(&self, format!("cpu, since this program is built without the feature `{feature}`"))
    }

    fn is_not_there(self, error: candle_core::Error) -> PolicyError {
        refuse(&self, format!("a device that this machine has ({})", PolicyError::from(error)))
    }
}

fn refuse(found: &impl ToString, expected: String) -> PolicyError {
    PolicyError::Config { field: "device", found: found.to_string(), expected }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cpu => f.write_str("cpu"),
            Self::Cuda(number) => write!(f, "cuda:{number}"),
            Self::Metal(number) => write!(f, "metal:{number}"),
        }
    }
}

impl FromStr for Device {
    type Err = PolicyError;

    fn from_str(text: &str) -> Result<Self, PolicyError> {
        let number = |text: &str| text.parse().ok();
        let found = match text.split_once(':') {
            None if text == "cpu" => Some(Self::Cpu),
            Some(("cuda", text)) => number(text).map(Self::Cuda),
            Some(("metal", text)) => number(text).map(Self::Metal),
            _ => None,
        };
        found.ok_or_else(|| refuse(&text, NAMES.to_owned()))
    }
}

impl From<Device> for String {
    fn from(device: Device) -> Self {
        device.to_string()
    }
}

impl TryFrom<String> for Device {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        // Whoever reads the file says which key this is.
        text.parse().map_err(|_: PolicyError| format!("unknown variant `{text}`, expected {NAMES}"))
    }
}

#[cfg(feature = "schema")]
impl schemars::JsonSchema for Device {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "Device".into()
    }

    fn json_schema(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
        schemars::json_schema!({ "type": "string", "pattern": "^(cpu|(cuda|metal):[0-9]+)$" })
    }
}

/// What computes a network: a back end and its device.
///
/// A [`Backend`] alone is one on the CPU.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Engine {
    /// The software.
    pub backend: Backend,
    /// Where it computes; `cpu` for the fast back end.
    pub device: Device,
}

impl From<Backend> for Engine {
    fn from(backend: Backend) -> Self {
        Self { backend, device: Device::Cpu }
    }
}

impl Engine {
    /// # Errors
    ///
    /// [`PolicyError::Config`] for the fast back end on anything but the CPU.
    pub fn validate(self) -> Result<(), PolicyError> {
        if self.backend == Backend::Fast && self.device != Device::Cpu {
            let expected = "cpu, or the back end `reference`, which alone computes on a GPU";
            return Err(refuse(&self.device, expected.to_owned()));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::backtrace::Backtrace;

    use super::*;

    #[test]
    fn names_are_read_and_written_back() {
        for name in ["cpu", "cuda:0", "cuda:7", "metal:0"] {
            assert_eq!(name.parse::<Device>().unwrap().to_string(), name);
            assert_eq!(serde_json::from_str::<Device>(&format!("{name:?}")).unwrap().to_string(), name);
        }
        for name in ["", "gpu", "cuda", "cuda:", "cuda:x", "cuda:-1", "cpu:0", "CUDA:0", "cuda:0:0"] {
            let refusal = name.parse::<Device>().unwrap_err().to_string();
            let expected =
                format!("network configuration: device: found {name}, expected cpu, cuda:N or metal:N");
            assert_eq!(refusal, expected);
            assert!(serde_json::from_str::<Device>(&format!("{name:?}")).is_err());
        }
    }

    #[test]
    fn the_fast_back_end_knows_the_processor_alone() {
        let engine = |backend, device| Engine { backend, device };
        assert!(engine(Backend::Fast, Device::Cpu).validate().is_ok());
        assert!(engine(Backend::Reference, Device::Cuda(0)).validate().is_ok());
        let refusal = engine(Backend::Fast, Device::Cuda(0)).validate().unwrap_err().to_string();
        assert!(refusal.contains("device: found cuda:0, expected cpu, or the back end"), "{refusal}");
    }

    #[test]
    #[cfg(not(any(feature = "cuda", feature = "metal")))]
    fn a_device_that_the_build_lacks_is_refused() {
        assert!(Device::Cpu.open().unwrap().is_cpu());
        for (device, feature) in [(Device::Cuda(0), "cuda"), (Device::Metal(1), "metal")] {
            let refusal = device.open().unwrap_err().to_string();
            let expected = format!(
                "network configuration: device: found {device}, expected cpu, since this program is built without the \
                 feature `{feature}`"
            );
            assert_eq!(refusal, expected);
        }
    }

    #[test]
    fn a_device_that_is_not_there_is_told_in_one_line() {
        let inner = Box::new(candle_core::Error::Msg("no driver".to_owned()));
        let backtrace = Box::new(Backtrace::force_capture());
        let error = candle_core::Error::WithBacktrace { inner, backtrace };
        assert_eq!(
            Device::Cuda(1).is_not_there(error).to_string(),
            "network configuration: device: found cuda:1, expected a device that this machine has (candle: no driver)"
        );
    }
}
