rule export:
    # Fields, pictures and tables of the model for other programs: `snakemake export`.
    input:
        **MESHES,
        rounds=rounds_and_solutions,
        data=f"{MODEL}/prepared.npz",
        estimate=f"{MODEL}/estimate.json",
        compare=f"{MODEL}/compare.npz",
    output:
        folder=directory(f"{MODEL}/export"),
    log:
        f"{MODEL}/logs/export.log",
    conda:
        "../envs/fingerfit.yaml"
    threads: 1
    resources:
        mem_mb=1000,
    params:
        code=CODE["export"],
        made_from=MADE_FROM["export"],
        model=subpath(input.estimate, parent=True),
    shell:
        "exec python -P -m fingerfit export {params.model} --out {output.folder} 2> {log}"
