"""Where alerts go: a command, a webhook, an MQTT broker, e-mail, syslog; each in its own thread."""
