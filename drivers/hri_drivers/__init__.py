"""Links to robot controllers: serial and CAN."""
