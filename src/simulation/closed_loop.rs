//! The parts of a scenario's closed loop: plant, controller, estimator.

use crate::simulation::scenario::{Element, Scenario};

impl Scenario {
    /// The plant.
    pub fn plant(&self) -> &Element {
        &self.elements[0]
    }

    /// The controller.
    pub fn controller(&self) -> &Element {
        &self.elements[1]
    }

    /// The estimator in the loop.
    pub fn estimator(&self) -> &Element {
        &self.elements[2]
    }

    /// Plant, controller and estimator.
    pub fn in_loop(&self) -> &[Element] {
        &self.elements[..3]
    }

    /// Estimators that run beside the loop on the same data.
    pub fn observers(&self) -> &[Element] {
        self.elements.get(3..).unwrap_or_default()
    }

    /// Removes the estimators beside the loop.
    pub fn remove_observers(&mut self) {
        self.elements.truncate(3);
    }

    /// The path of a variable, such as `plant.lambda[1]`, from the indices of its element and its own.
    pub fn path(&self, (element, variable): (usize, usize)) -> String {
        let element = &self.elements[element];
        format!("{}.{}", element.name, element.model_type.variables()[variable].name)
    }
}
