import sys, importlib.util, time
from pathlib import Path
HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "shared"))
import fuzzing, tempfile
def load(f):
    s=importlib.util.spec_from_file_location(f.stem,f); m=importlib.util.module_from_spec(s); s.loader.exec_module(m); return m.READERS
want,count,seed=sys.argv[1],int(sys.argv[2]),int(sys.argv[3])
for f in sorted(HERE.glob("test_*.py")):
    for r in load(f):
        if want in r.name:
            t=time.time()
            with tempfile.TemporaryDirectory() as d:
                out=fuzzing.run_batch(r,Path(d),seed,count)
                import shutil
                shutil.rmtree("/tmp/fz/"+r.name.replace("/","_"),ignore_errors=True); shutil.copytree(Path(d)/"outside","/tmp/fz/"+r.name.replace("/","_"),symlinks=True)
            from collections import Counter
            import re
            c=Counter(re.sub(r"/tmp/\S+|\d+","#",x)[:230] for x in out.failures)
            print(r.name,out.inputs,out.results,dict(out.refused),"long",round(out.longest_s,3),"cmd",out.commands,"sec",round(time.time()-t,1))
            for k,v in c.most_common(25): print("  ",v,k)
