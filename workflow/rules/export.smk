rule export_model:
    # Fields, pictures and tables of a model for other programs: `snakemake export`.
    input:
        meshes=meshes,
        rounds=rounds_and_solutions,
        data=data,
        estimate="{study}/{model}/estimate.json",
        compare="{study}/{model}/compare.npz",
    output:
        folder=directory("{study}/{model}/export"),
    log:
        "{study}/{model}/logs/export.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=memory(),
        runtime=minutes("export_model"),
    params:
        code=part("export", "code"),
        made_from=part("export", "made_from"),
        model=subpath(input.estimate, parent=True),
    shell:
        "exec python -P -m fingerfit export {params.model} --out {output.folder} 2> {log}"
