localrules:
    settings,


rule settings:
    # What is fitted to what in one model, and where its search starts: config.yaml with all defaults, for its jobs.
    input:
        below=below("estimate.json"),
    output:
        settings="{study}/{model}/settings.json",
    log:
        "{study}/{model}/logs/settings.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=500,
    params:
        given=given,
        text=settings_text,
        config=CONFIG,
    shell:
        "exec python -P -m fingerfit settings {params.given:q} --config {params.config:q} --out {output.settings} 2> {log}"


rule prepare:
    # Reads and checks the study, smooths and scales the pictures, makes the mesh.
    input:
        settings="{study}/{model}/settings.json",
        study=study_files,
    output:
        mesh="{study}/{model}/mesh{test}.inp",
        data="{study}/{model}/prepared{test}.npz",
    log:
        "{study}/{model}/logs/prepare{test}.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=memory(),
        runtime=minutes("prepare"),
    params:
        settings=part("prepare", "settings"),
        code=part("prepare", "code"),
        made_from=part("prepare", "made_from"),
    shell:
        "exec python -P -m fingerfit prepare {input.settings} --out {output.data} --mesh {output.mesh}"
        " --test={wildcards.test} 2> {log}"


rule refine:
    # The finer mesh of the last steps, for models that have one.
    input:
        settings="{study}/{model}/settings.json",
        study=study_files,
    output:
        mesh="{study}/{model}/refined{test}.inp",
    log:
        "{study}/{model}/logs/refine{test}.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=memory(),
        runtime=minutes("refine"),
    params:
        settings=part("prepare", "settings"),
        code=part("prepare", "code"),
        made_from=part("prepare", "made_from"),
    shell:
        "exec python -P -m fingerfit prepare {input.settings} --refined {output.mesh} --test={wildcards.test}"
        " 2> {log}"
