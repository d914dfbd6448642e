# The entry: everything happens in workflow/. The default rule is set here because an include resets it.
include: "workflow/Snakefile"


rule default:
    default_target: True
    input:
        rules.all.input,
