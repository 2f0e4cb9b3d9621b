"""Alert receivers: command, webhook, MQTT broker, e-mail, syslog; each in its own thread."""
