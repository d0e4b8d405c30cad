"""From measurements to a device: the numbers of a scenario that its histories agree best with."""
