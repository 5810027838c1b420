"""Settings by their last names alone, which no two stages share."""

from analysis.model.settings import Settings

STAGE_OF = {
    name: stage
    for stage, model in Settings.list_stage_models().items()
    for name in model.model_fields
}


def staged(**values):
    """The content of a `[settings]` table; what is named after a stage stays as it is."""
    content = {}
    for name, value in values.items():
        if name in Settings.list_stage_models():
            content[name] = value
        else:
            content.setdefault(STAGE_OF[name], {})[name] = value
    return content


def settings_of(**values):
    """Settings that differ from the defaults in `values`."""
    return Settings.model_validate(staged(**values))
